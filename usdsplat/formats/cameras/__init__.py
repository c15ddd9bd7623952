"""Read the cameras of a capture's photographs from COLMAP models and `transforms.json`.

Poses are in the coordinates of the capture that was trained from the photographs. Those coordinates
are the ones in which `formats.read` returns the capture.
"""

from __future__ import annotations

from pathlib import Path

from usdsplat.core.errors import FormatError
from usdsplat.core.progress import Progress, silent
from usdsplat.formats.cameras import colmap, transforms
from usdsplat.formats.cameras.lens import Lens
from usdsplat.formats.cameras.posed import CameraSet, Posed

__all__ = ["CameraSet", "Lens", "Posed", "read"]

_INSIDE = ("", "sparse/0", "sparse", "colmap/sparse/0")
"""Subfolders of a dataset in which a COLMAP model is looked for, in this order."""


def read(path: str | Path, *, progress: Progress = silent) -> CameraSet:
    """Read cameras.

    Args:
        path: A `transforms.json` of instant-ngp or nerfstudio, under any name; a folder with
            COLMAP's `cameras` and `images`, both .bin or both .txt; one of these files; or a
            dataset folder that contains a model or a `transforms.json`.
        progress: Receives the number of cameras read.

    Raises:
        FormatError: If nothing of this kind is found, or a file is damaged.
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        return transforms.read(path, progress)
    if path.is_dir():
        for inside in _INSIDE:
            if found := colmap.find(path / inside):
                return colmap.read(*found, progress)
        if (path / transforms.NAME).is_file():
            return transforms.read(path / transforms.NAME, progress)
    elif path.is_file() and (found := colmap.find(path.parent, like=path)):
        return colmap.read(*found, progress)
    found_there = "something else" if path.exists() else "nothing"
    expected = f"COLMAP's cameras and images, .bin or .txt, or a {transforms.NAME}"
    raise FormatError(str(path), found_there, expected)
