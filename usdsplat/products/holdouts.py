"""Open the holdouts of pictures, and report those that cannot hide what they should."""

from __future__ import annotations

from typing import TYPE_CHECKING

from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.wording import counted
from usdsplat.images.frame_numbers import frame_path
from usdsplat.products.request import PicturePlan

if TYPE_CHECKING:
    from usdsplat.images.holdout import Holdout


def holdout_of(plan: PicturePlan, frame: float) -> Holdout | None:
    """Open the holdout of a picture at a frame; None if it has none.

    Raises:
        UsageError: If the file does not exist, or has another display window.
        FormatError: If it has no depth, or is not a picture.
    """
    if plan.holdout is None:
        return None
    from usdsplat.images.holdout import open_holdout

    return open_holdout(frame_path(plan.holdout, frame), resolution=plan.framing.resolution)


def check_file(plan: PicturePlan, frame: float) -> None:
    """Raise an error if the file of a holdout is missing."""
    if plan.holdout is not None:
        path = frame_path(plan.holdout, frame)
        if not path.is_file():
            raise UsageError("--holdout", f"no file {path}", "an EXR with depth")


def lacking_depth(plan: PicturePlan, holdout: Holdout | None) -> Finding | None:
    """Return a finding if pixels of a flat holdout have A above 0 but no depth."""
    if plan.holdout is None or holdout is None or not holdout.without_depth:
        return None
    pixels = counted(holdout.without_depth, "pixel")
    return finding(
        "holdout-depth", f"--holdout {plan.holdout}",
        f"{pixels} with A above 0 and without a finite Z above 0", "a Z wherever A is above 0",
    )  # fmt: skip
