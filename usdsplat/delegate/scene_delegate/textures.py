"""Read the textures of a stage, each once."""

from __future__ import annotations

from collections.abc import Hashable, MutableMapping
from weakref import WeakValueDictionary

import numpy as np
from pxr import Ar, Sdf

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError, UsdSplatError
from usdsplat.images.texture import Encoding, read_packed_texture, read_texture

Color = tuple[float, float, float]


class Textures:
    """Cache of texture pixels by resolved path, encoding, scale and bias, while a mesh uses them.

    Textures that change every frame are therefore freed. Files in use, and files that could not be
    read, are not read again: changes on disk appear in the next engine.
    """

    def __init__(self) -> None:
        self._found: MutableMapping[Hashable, F32] = WeakValueDictionary()
        self._errors: dict[Hashable, UsdSplatError] = {}

    def clear(self) -> None:
        """Clear the cache."""
        self._found.clear()
        self._errors.clear()

    def read(self, asset: Sdf.AssetPath, encoding: Encoding) -> F32:
        """Return the pixels of a texture in the form of `images.texture`.

        Raises:
            FormatError: If it is not there, or no picture.
        """
        key = (asset.resolvedPath or asset.path, encoding)
        if why := self._errors.get(key):
            raise why
        pixels = self._found.get(key)
        if pixels is None:
            try:
                pixels = self._found[key] = read_asset(asset, encoding)
            except UsdSplatError as error:
                self._errors[key] = error
                raise
        return pixels

    def read_biased(
        self, asset: Sdf.AssetPath, encoding: Encoding, *, scale: Color, bias: Color
    ) -> F32:
        """Return scale · pixel + bias.

        Raises:
            FormatError: If it is not there, or no picture.
        """
        key = (asset.resolvedPath or asset.path, encoding, scale, bias)
        pixels = self._found.get(key)
        if pixels is None:
            found = self.read(asset, encoding)
            pixels = found * np.array(scale, np.float32) + np.array(bias, np.float32)
            self._found[key] = pixels
        return pixels


def read_asset(asset: Sdf.AssetPath, encoding: Encoding) -> F32:
    """Return the pixels of a picture, which may be in a package, in the form of `images.texture`.

    Raises:
        FormatError: If it is not there, or no picture.
    """
    path = asset.resolvedPath
    if not path:
        raise FormatError(asset.path or "a texture", "no file", "an existing picture")
    if not Ar.IsPackageRelativePath(path):
        return read_texture(path, encoding=encoding)
    packed = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not packed:
        raise FormatError(path, "no such file in the package", "an existing picture")
    # The file name inside the package, without brackets.
    name = Ar.SplitPackageRelativePathInner(path)[1]
    return read_packed_texture(bytes(packed.GetBuffer()), name, encoding=encoding)
