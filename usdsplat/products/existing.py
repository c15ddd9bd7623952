"""Find out whether an existing picture is complete, and is what would be drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from usdsplat.core.readable import readable
from usdsplat.images.aovs import find_aovs
from usdsplat.images.deep_aovs import deep_channels
from usdsplat.images.layout import ImageLayout
from usdsplat.images.png import is_whole_png
from usdsplat.images.whole_exr import is_whole_exr
from usdsplat.products.header import layout_of
from usdsplat.products.request import PicturePlan


def difference(plan: PicturePlan, frame: float, path: Path, *, stage_hash: str) -> str:
    """Return how an existing picture differs from a plan; "" if it need not be drawn again.

    The file must be complete. Resolution, data window, channels, frame, samples and, in an EXR, the
    hash of the stage's files are compared. No pixel is read, and other settings are not compared.

    Args:
        plan: The picture.
        frame: Time code.
        path: The existing file.
        stage_hash: Result of `source_hash` for the files of the stage; "" compares none.
    """
    if not path.is_file():
        return "something that is not a plain file"
    is_png = path.suffix.lower() == ".png"
    if not (is_whole_png if is_png else is_whole_exr)(path):
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
    found = specs[0].getattribute("usdsplat:stageHash")
    if stage_hash and found and found != stage_hash:
        return "a picture of another version of the stage's files"
    return _differing(specs, plan, layout_of(plan), frame, is_png=is_png)


def _differing(
    specs: list[oiio.ImageSpec],
    plan: PicturePlan,
    layout: ImageLayout,
    frame: float,
    *,
    is_png: bool,
) -> str:
    """Return how the headers of a file differ from the layout of a picture; "" if they do not."""
    first = specs[0]
    x0, y0, x1, y1 = layout.window
    size = (first.width, first.height)
    display = size if is_png else (first.full_width, first.full_height)
    expected = (x1 - x0, y1 - y0) if is_png else layout.resolution
    if display != expected:
        return f"a picture of {display[0]}x{display[1]}"
    if size != (x1 - x0, y1 - y0) or (not is_png and (first.x, first.y) != (x0, y0)):
        return "a picture with another data window"
    if bool(first.deep) != plan.deep:
        return "a deep picture" if first.deep else "a flat picture"
    if not is_png:
        if plan.deep:
            wanted = set(deep_channels(layout.aovs, merged=plan.settings.deep_error > 0))
        else:
            aovs = (aov.with_rank(layout.crypto_rank) for aov in find_aovs(layout.aovs))
            wanted = {name for aov in aovs for name in aov.channels}
        if {name for spec in specs for name in spec.channelnames} != wanted:
            return "a picture with other channels"
    for key, value in {"frame": frame, "samples": plan.settings.samples}.items():
        found = first.getattribute(f"usdsplat:{key}")
        if found is None or np.float32(found) != np.float32(value):  # as an EXR has it
            return f"a picture with {'no' if found is None else 'another'} {key} in its header"
    return ""
