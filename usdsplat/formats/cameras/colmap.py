"""Read a sparse COLMAP model: `cameras` with lenses and `images` with poses, text or binary.

Poses are stored from world to camera. A capture that was trained from a model shares its world
space. Points are not read.

Source: COLMAP, doc/format.rst.
"""

from __future__ import annotations

from pathlib import Path

from usdsplat.core.errors import FormatError
from usdsplat.core.progress import Progress
from usdsplat.formats.cameras import colmap_binary, colmap_text
from usdsplat.formats.cameras.posed import CameraSet, Stored, checked_count, from_world_to_camera

_FORMS = {".bin": ("COLMAP binary", colmap_binary), ".txt": ("COLMAP text", colmap_text)}
_STEP = 256


def find(folder: Path, *, like: Path | None = None) -> tuple[Path, Path] | None:
    """Return the lens and image files in a folder, or None; binary files take precedence.

    Args:
        folder: The folder to search.
        like: One of the two files, if the user named it; the other must have the same suffix.
    """
    if like is not None and like.stem not in ("cameras", "images"):
        return None
    for suffix in _FORMS if like is None else (like.suffix.lower(),):
        lenses, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
        if suffix in _FORMS and lenses.is_file() and images.is_file():
            return lenses, images
    return None


def read(lenses: Path, images: Path, progress: Progress) -> CameraSet:
    """Read the two files of a model.

    Raises:
        FormatError: If a file cannot be opened, is damaged, or is not COLMAP's.
    """
    name, form = _FORMS[images.suffix.lower()]
    found: list[Stored] = []
    try:
        known = form.lenses(lenses)
        for stored in form.images(images, known):
            checked_count(str(images), len(found) + 1)
            found.append(stored)
            if len(found) % _STEP == 0:
                progress.step("reading cameras", len(found), 0)
    except OSError as error:
        said = (error.strerror or str(error)).lower()
        raise FormatError(error.filename or str(images), said, "a readable file") from error
    checked_count(str(images), len(found))
    cameras = from_world_to_camera(str(images), found)
    progress.step("reading cameras", len(found), len(found))
    return CameraSet(format=name, files=(lenses, images), cameras=cameras)
