"""Choose the axes of a capture: those given, else the file's, else the evidence of its splats."""

from __future__ import annotations

from dataclasses import dataclass, replace

from usdsplat.formats import Capture
from usdsplat.formats.capture import UNKNOWN_AXES, FrameSource
from usdsplat.interchange.frame_guess import guess_frame

AUTO = "auto"
"""Value of an option that means the same as None."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesChoice:
    """The axes of a capture, and where they are from."""

    frame: str
    source: FrameSource
    score: float | None = None
    """Score of the evidence, see `frame_guess`; None for other sources."""
    note: str = ""
    """Sentence for the user; "" if the file states its axes or they were given."""


def choose_axes(capture: Capture, asked: str | None = None) -> AxesChoice:
    """Return the axes of a capture.

    Args:
        capture: The capture as it was read, before edits.
        asked: Axes that the caller gives; None or "auto" uses the file's, else the axes whose up
            direction the splats show, else those that are customary for the format.

    Raises:
        UsageError: If the capture's axes are no axes.
    """
    if asked not in (None, AUTO):
        return AxesChoice(frame=str(asked), source="given")
    if capture.frame_source != "assumed":
        return AxesChoice(frame=capture.frame, source=capture.frame_source)
    guess = guess_frame(capture.cloud, capture.frame)
    shown = "; ".join(guess.evidence)
    if guess.suggested is None:
        note = f"{UNKNOWN_AXES} ({shown})"
        return AxesChoice(frame=capture.frame, source="assumed", note=note)
    # The evidence is for an up direction: of all axes with it, customary ones come first.
    frame = capture.frame if guess.agrees else guess.suggested
    note = f"the file does not say where its axes point: {frame!r} by the evidence ({shown})"
    return AxesChoice(frame=frame, source="evidence", score=guess.score, note=note)


def with_axes(capture: Capture, choice: AxesChoice) -> Capture:
    """Return the capture with chosen axes, and the choice's note in place of the reader's.

    A capture that states its axes keeps them, unless others are given.
    """
    if choice.source != "given" and capture.frame_source == "file":
        return capture
    notes = tuple(note for note in capture.notes if note != UNKNOWN_AXES)
    return replace(
        capture,
        frame=choice.frame,
        frame_source=choice.source,
        frame_score=choice.score,
        notes=(choice.note, *notes) if choice.note else notes,
    )
