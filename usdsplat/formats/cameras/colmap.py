"""A sparse model of COLMAP: `cameras` with lenses and `images` with poses, text or binary.

Poses are stored from world to camera, and captures that are trained from a model keep its world.
Points are not read.

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
    """The files with lenses and poses in a folder, binary ones first as COLMAP has it, if any.

    Args:
        folder: Where to look.
        like: One of the two, if that is what was named; the other is then of its kind.
    """
    if like is not None and like.stem not in ("cameras", "images"):
        return None
    for suffix in _FORMS if like is None else (like.suffix.lower(),):
        lenses, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
        if suffix in _FORMS and lenses.is_file() and images.is_file():
            return lenses, images
    return None


def read(lenses: Path, images: Path, progress: Progress) -> CameraSet:
    """Read a model's two files.

    Raises:
        FormatError: If one is damaged or of another kind, or cannot be opened.
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
