"""Select the frames of a stage to draw."""

from __future__ import annotations

import math
from collections.abc import Sequence

from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.wording import counted
from usdsplat.delegate.scene_delegate import Stage
from usdsplat.images.frame_numbers import LIMIT, parse_frames
from usdsplat.products.request import PicturePlan

WHOLE_RANGE = "stage"
"""Request for all frames from the stage's startTimeCode to its endTimeCode."""


def first_frame(stage: Stage, asked: str | None) -> float:
    """Return the first frame to draw. It does not depend on plans.

    Args:
        stage: The stage to draw.
        asked: Requested frames in the format of `parse_frames`, or `WHOLE_RANGE`; None for the
            stage's own.

    Raises:
        UsageError: If `asked` is not a valid range.
        StageError: If it is `WHOLE_RANGE`, and the stage has none.
    """
    return frames_to_draw(stage, asked, ())[0]


def framed(frames: Sequence[float]) -> tuple[float, ...]:
    """Return the frames that the camera of a picture without one frames, each once: the first, the
    middle and the last one."""
    return tuple(dict.fromkeys((frames[0], frames[len(frames) // 2], frames[-1])))


def outside_range(stage: Stage, frames: Sequence[float]) -> Finding | None:
    """Return a finding if frames are outside of the stage's range; None if it has no range."""
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    beyond = [frame for frame in frames if not first <= frame <= last]
    if not beyond or not stage.HasAuthoredTimeCodeRange():
        return None
    others = f" (and {counted(len(beyond) - 1, 'more frame')})" if len(beyond) > 1 else ""
    found = f"frame {beyond[0]:g}{others}"
    return finding("outside-range", "frames", found, f"{first:g} to {last:g}, the stage's range")


def frames_to_draw(
    stage: Stage, asked: str | None, plans: Sequence[PicturePlan]
) -> tuple[float, ...]:
    """Return the requested frames, or the stage's own.

    `WHOLE_RANGE` requests all frames of the stage. Without a request, these are drawn if a file
    name depends on the frame, otherwise the first frame, and 0 for a stage without a range.

    Args:
        stage: The stage to draw.
        asked: See `first_frame`.
        plans: The pictures with their file names.

    Raises:
        UsageError: If `asked` is not a valid range.
        StageError: If it is `WHOLE_RANGE`, and the stage has none; or the stage has too many.
    """
    if asked is not None and asked != WHOLE_RANGE:
        return parse_frames(asked)
    if not stage.HasAuthoredTimeCodeRange():
        if asked == WHOLE_RANGE:
            expected = "startTimeCode and endTimeCode, or frames such as 1-10"
            raise StageError("--frames", "a stage without a range", expected)
        return (0.0,)
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if asked == WHOLE_RANGE or any(plan.output.is_sequence for plan in plans):
        if not -math.inf < last - first < LIMIT:  # true for NaN, too
            found, expected = f"the range {first:g} to {last:g}", f"{LIMIT} frames or fewer"
            raise StageError("stage startTimeCode and endTimeCode", found, expected)
        return tuple(first + i for i in range(max(int(last - first), 0) + 1))
    return (first,)
