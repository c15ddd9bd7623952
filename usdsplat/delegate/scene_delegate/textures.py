"""Textures of one stage, each read once."""

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
    """Resolved path, encoding, scale and bias -> pixels, for as long as some mesh shows them.

    So textures that are other ones in each frame do not pile up. A file that is in use is not
    looked at again, nor is one that could not be read: what changes on disk shows in the next
    engine.
    """

    def __init__(self) -> None:
        self._found: MutableMapping[Hashable, F32] = WeakValueDictionary()
        self._errors: dict[Hashable, UsdSplatError] = {}

    def clear(self) -> None:
        """Let go of all pixels."""
        self._found.clear()
        self._errors.clear()

    def read(self, asset: Sdf.AssetPath, encoding: Encoding) -> F32:
        """Return the pixels of a texture, as `images.texture` has them.

        Raises:
            FormatError: If it is not there, or no picture.
        """
        key = (asset.resolvedPath or asset.path, encoding)
        if why := self._errors.get(key):
            raise why
        pixels = self._found.get(key)
        if pixels is None:
            try:
                pixels = self._found[key] = _read(asset, encoding)
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


def _read(asset: Sdf.AssetPath, encoding: Encoding) -> F32:
    path = asset.resolvedPath
    if not path:
        raise FormatError(asset.path or "a texture", "no file", "a picture that is there")
    if not Ar.IsPackageRelativePath(path):
        return read_texture(path, encoding=encoding)
    packed = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not packed:
        raise FormatError(path, "no such file in the package", "a picture that is there")
    # the file's own name, free of the brackets that packages put about it
    name = Ar.SplitPackageRelativePathInner(path)[1]
    return read_packed_texture(bytes(packed.GetBuffer()), name, encoding=encoding)
