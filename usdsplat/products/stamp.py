"""Identify what decides a picture, so that it is drawn again if any of it changes."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from usdsplat import __version__
from usdsplat.images.frame_numbers import frame_path
from usdsplat.images.view import config_in_effect
from usdsplat.products.request import NO_NAME, PicturePlan
from usdsplat.products.source_hash import source_hash

_DIGITS = 32


def picture_stamp(
    plan: PicturePlan,
    frame: float,
    *,
    source: str,
    opening: Sequence[str] = (),
    fitted: Sequence[float] = (),
) -> str:
    """Return hexadecimal digits that are equal for pictures that are made of the same in the same
    way, in whatever folder, by whatever device and number of threads.

    Args:
        plan: Plan of the whole picture. Its holdout and its OCIO config count by their content.
        frame: Time code.
        source: Hash of the files of the stage, see `header.stage_hash`, or of the capture.
        opening: How the stage was opened, see `DrawOptions.opening`.
        fitted: Frames that the camera of a picture without one frames.
    """
    shown = plan.settings
    config = shown.ocio_config
    if any((config, shown.ocio_display, shown.ocio_view, shown.ocio_look)):
        config = config_in_effect(config)
    read = [str(frame_path(plan.holdout, frame))] if plan.holdout else []
    if Path(config).is_file():
        read.append(config)
        config = ""
    rank = shown.crypto_rank
    settings = replace(
        shown,
        ocio_config=config,
        background="",  # the plan has its colour
        node_memory=0,
        node_lifetime=0.0,
        crypto_rank=rank + rank % 2,  # what layers of two pairs hold
    )
    made = replace(
        plan,
        output=NO_NAME,
        purposes=tuple(sorted(plan.purposes)),
        holdout=None,
        compare=True,
        findings=(),
        settings=settings,
    )
    framed = tuple(map(float, fitted)) if plan.camera is None else ()
    values = [__version__, repr(made), repr(float(frame)), repr(framed), source, *opening]
    values += [source_hash([path]) for path in read]
    whole = hashlib.sha256("\0".join(values).encode(errors="surrogateescape"))
    return whole.hexdigest()[:_DIGITS]
