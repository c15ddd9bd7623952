"""Textures of one stage, each read once."""

from __future__ import annotations

import numpy as np
from pxr import Ar, Sdf

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError, UsdSplatError
from usdsplat.images.texture import Encoding, read_packed_texture, read_texture

Color = tuple[float, float, float]


class Textures:
    """Resolved path, encoding, scale and bias -> pixels, for the life of one engine.

    A file that was read is not looked at again: what changes on disk shows in the next engine.
    """

    def __init__(self) -> None:
        self._found: dict[tuple[str, Encoding], F32 | UsdSplatError] = {}
        self._biased: dict[tuple[str, Encoding, Color, Color], F32] = {}

    def clear(self) -> None:
        """Let go of all pixels."""
        self._found.clear()
        self._biased.clear()

    def read(self, asset: Sdf.AssetPath, encoding: Encoding) -> F32:
        """Return the pixels of a texture, as `images.texture` has them.

        Raises:
            FormatError: If it is not there, or no picture.
        """
        key = (asset.resolvedPath or asset.path, encoding)
        if key not in self._found:
            try:
                self._found[key] = _read(asset, encoding)
            except UsdSplatError as error:
                self._found[key] = error
        found = self._found[key]
        if isinstance(found, UsdSplatError):
            raise found
        return found

    def read_biased(
        self, asset: Sdf.AssetPath, encoding: Encoding, *, scale: Color, bias: Color
    ) -> F32:
        """Return scale · pixel + bias.

        Raises:
            FormatError: If it is not there, or no picture.
        """
        pixels = self.read(asset, encoding)
        key = (asset.resolvedPath or asset.path, encoding, scale, bias)
        if key not in self._biased:
            self._biased[key] = pixels * np.array(scale, np.float32) + np.array(bias, np.float32)
        return self._biased[key]


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
