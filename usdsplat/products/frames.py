"""Select the frames of a stage to draw."""

from __future__ import annotations

from collections.abc import Sequence

from usdsplat.delegate.scene_delegate import Stage
from usdsplat.images.frame_numbers import has_place, parse_frames
from usdsplat.products.request import PicturePlan


def first_frame(stage: Stage, asked: str | None) -> float:
    """Return the first frame to draw. It does not depend on plans.

    Args:
        stage: The stage to draw.
        asked: Requested frames in the format of `parse_frames`; None for the stage's own.

    Raises:
        UsageError: If `asked` is not a valid range.
    """
    return frames_to_draw(stage, asked, ())[0]


def frames_to_draw(
    stage: Stage, asked: str | None, plans: Sequence[PicturePlan]
) -> tuple[float, ...]:
    """Return the requested frames, or the stage's own.

    Without a request, these are the stage's whole range if a file name has a placeholder for the
    frame number, otherwise its first frame, and 0 for a stage without a range.

    Args:
        stage: The stage to draw.
        asked: See `first_frame`.
        plans: The pictures with their file names.

    Raises:
        UsageError: If `asked` is not a valid range.
    """
    if asked is not None:
        return parse_frames(asked)
    if not stage.HasAuthoredTimeCodeRange():
        return (0.0,)
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if last > first and any(has_place(plan.output) for plan in plans):
        return tuple(first + i for i in range(int(last - first) + 1))
    return (first,)
