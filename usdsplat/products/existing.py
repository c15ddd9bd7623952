"""Find out whether an existing picture is complete, and is what would be drawn."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from usdsplat.core.readable import readable
from usdsplat.images import exif
from usdsplat.images.aovs import find_aovs
from usdsplat.images.background import TRANSPARENT, described
from usdsplat.images.deep_aovs import deep_channels
from usdsplat.images.jpeg import is_whole_jpeg
from usdsplat.images.layout import ImageLayout
from usdsplat.images.png import is_whole_png
from usdsplat.images.webp_writer import is_whole_webp
from usdsplat.images.whole_exr import is_whole_exr
from usdsplat.products.header import layout_of
from usdsplat.products.request import PicturePlan

_WHOLE = {
    ".exr": is_whole_exr, ".png": is_whole_png, ".webp": is_whole_webp, ".jpg": is_whole_jpeg,
    ".jpeg": is_whole_jpeg,
}  # fmt: skip
"""Suffix -> whether a file is complete."""


def difference(plan: PicturePlan, frame: float, path: Path, *, stage_hash: str, stamp: str) -> str:
    """Return how an existing picture differs from a plan; "" if it need not be drawn again.

    The file must be complete. Resolution, data window, channels, frame, samples, background and,
    where the header has them, the hash of the stage's files and the stamp are compared. No pixel is
    read.

    Args:
        plan: The picture.
        frame: Time code.
        path: The existing file.
        stage_hash: Result of `source_hash` for the files of the stage; "" compares none.
        stamp: Result of `picture_stamp`; "" compares none.
    """
    if not path.is_file():
        return "something that is not a plain file"
    suffix = path.suffix.lower()
    if not _WHOLE[suffix](path):
        return "a truncated file"
    file = oiio.ImageInput.open(readable(path))
    if file is None:
        return f"a file that cannot be read ({oiio.geterror()})"
    try:
        specs = [file.spec()]
        while file.seek_subimage(len(specs), 0):
            specs.append(file.spec().copy())
    finally:
        file.close()
    entries = _entries(specs[0], path)
    found = entries.get("usdsplat:stageHash")
    if stage_hash and found and found != stage_hash:
        return "a picture of another version of the stage's files"
    layout, is_exr = layout_of(plan), suffix == ".exr"
    differing = _differing(specs, plan, layout, is_exr=is_exr) or _relabelled(entries, plan, frame)
    made = entries.get("usdsplat:stamp")
    if differing or not (stamp and made) or made == stamp:
        return differing
    return "a picture made with another setting, file or version of usdsplat"


def _entries(spec: oiio.ImageSpec, path: Path) -> dict[str, Any]:
    """Return the header entries of a picture that `--resume` compares with the plan."""
    from PIL import Image as pillow

    names = ("stageHash", "stamp", "frame", "samples", "background")
    keys = [f"usdsplat:{name}" for name in names]
    if path.suffix.lower() in (".exr", ".png"):
        return {key: spec.getattribute(key) for key in keys}
    most = pillow.MAX_IMAGE_PIXELS
    pillow.MAX_IMAGE_PIXELS = None  # no pixel is decoded
    try:
        with pillow.open(path) as file:
            text = file.getexif().get(exif.DESCRIPTION, "{}")
    finally:
        pillow.MAX_IMAGE_PIXELS = most
    try:
        found = json.loads(text)
    except ValueError:  # another program's description
        found = None
    return {key: found.get(key) for key in keys} if isinstance(found, dict) else {}


def _relabelled(entries: dict[str, Any], plan: PicturePlan, frame: float) -> str:
    """Return how the header entries of a file differ from a plan; "" if they do not."""
    for key, value in {"frame": frame, "samples": plan.settings.samples}.items():
        found = entries.get(f"usdsplat:{key}")
        if found is None or np.float32(found) != np.float32(value):  # as an EXR has it
            return f"a picture with {'no' if found is None else 'another'} {key} in its header"
    found = entries.get("usdsplat:background") or TRANSPARENT
    return "" if found == described(plan.background) else "a picture with another background"


def _differing(
    specs: list[oiio.ImageSpec],
    plan: PicturePlan,
    layout: ImageLayout,
    *,
    is_exr: bool,
) -> str:
    """Return how size and channels of a file differ from a layout; "" if they do not."""
    first = specs[0]
    x0, y0, x1, y1 = layout.window
    size = (first.width, first.height)
    display = (first.full_width, first.full_height) if is_exr else size
    expected = layout.resolution if is_exr else (x1 - x0, y1 - y0)
    if display != expected:
        return f"a picture of {display[0]}x{display[1]}"
    if size != (x1 - x0, y1 - y0) or (is_exr and (first.x, first.y) != (x0, y0)):
        return "a picture with another data window"
    if bool(first.deep) != plan.deep:
        return "a deep picture" if first.deep else "a flat picture"
    if is_exr:
        if plan.deep:
            wanted = set(deep_channels(layout.aovs, merged=plan.settings.deep_error > 0))
        else:
            aovs = (aov.with_rank(layout.crypto_rank) for aov in find_aovs(layout.aovs))
            wanted = {name for aov in aovs for name in aov.channels}
        if {name for spec in specs for name in spec.channelnames} != wanted:
            return "a picture with other channels"
    return ""
