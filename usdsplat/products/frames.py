"""Decide which frames of a stage are drawn."""

from __future__ import annotations

from collections.abc import Sequence

from usdsplat.delegate.scene_delegate import Stage
from usdsplat.images.frames import has_place, parse_frames
from usdsplat.products.request import PicturePlan


def first_frame(stage: Stage, asked: str | None) -> float:
    """Return the first frame to draw, which is known before there are plans.

    Args:
        stage: What is drawn.
        asked: Frames that the user asks for, as `parse_frames` reads them; None if none.

    Raises:
        UsageError: If `asked` is no range.
    """
    return frames_to_draw(stage, asked, ())[0]


def frames_to_draw(
    stage: Stage, asked: str | None, plans: Sequence[PicturePlan]
) -> tuple[float, ...]:
    """Return the frames that the user asks for, or the stage's own.

    Without a wish it is the stage's whole range if a file name has a place for the frame number,
    else its first frame; 0 on a stage without a range.

    Args:
        stage: What is drawn.
        asked: As in `first_frame`.
        plans: What is drawn into which files.

    Raises:
        UsageError: If `asked` is no range.
    """
    if asked is not None:
        return parse_frames(asked)
    if not stage.HasAuthoredTimeCodeRange():
        return (0.0,)
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if last > first and any(has_place(plan.output) for plan in plans):
        return tuple(first + i for i in range(int(last - first) + 1))
    return (first,)
