"""Divide a sequence into tasks."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from usdsplat.core.errors import UsageError
from usdsplat.jobs.job import Command, Job, Parameter, Slot, Step
from usdsplat.products.tiles import Tiling

DRAW, JOIN = "draw", "join"
FRAMES, TILE = "frames", "tile"
TURNS = 8
"""Number of tasks of each worker if all had the size of the first ones."""


def render_job(
    command: Command,
    frames: Sequence[float],
    *,
    name: str,
    chunk: int | None = None,
    workers: int = 1,
    tiling: Tiling | None,
    uses_gpu: bool = False,
    memory: int | None = None,
) -> Job:
    """Return the job of a `usdsplat render`.

    Args:
        command: The command without frames and tile.
        frames: Time codes.
        name: Name of the job.
        chunk: Number of frames of a task; None to share them out, see `shared_out`.
        workers: Number of workers that share them.
        tiling: Tiles that are drawn by tasks of their own; then a task joins those of a chunk.
        uses_gpu: Whether a GPU draws. The task that joins tiles opens the device too.
        memory: See `Job`.

    Raises:
        UsageError: If a chunk has no frame.
    """
    chunks = _chunks(frames, chunk, workers)
    command = (*command, Slot("--frames", FRAMES))
    if tiling is None:
        step = Step(name=DRAW, command=command, space=(chunks,), uses_gpu=uses_gpu)
        return Job(name=name, steps=(step,), memory=memory)
    tiles = Parameter(name=TILE, values=tuple(str(n + 1) for n in range(len(tiling))))
    drawing = (*command, Slot("--tile", TILE))
    draw = Step(name=DRAW, command=drawing, space=(chunks, tiles), uses_gpu=uses_gpu)
    joining = (*command, "--tile=join")
    join = Step(name=JOIN, command=joining, space=(chunks,), after=(DRAW,), uses_gpu=uses_gpu)
    return Job(name=name, steps=(draw, join), memory=memory)


def frames_job(
    command: Command,
    frames: Sequence[float],
    *,
    name: str,
    chunk: int | None = None,
    workers: int = 1,
) -> Job:
    """Return a job whose tasks are frames side by side.

    Args:
        command: The command without frames.
        frames: Time codes.
        name: Name of the job.
        chunk, workers: As for `render_job`.

    Raises:
        UsageError: If a chunk has no frame.
    """
    chunks = _chunks(frames, chunk, workers)
    step = Step(name=name, command=(*command, Slot("--frames", FRAMES)), space=(chunks,))
    return Job(name=name, steps=(step,))


def _chunks(frames: Sequence[float], chunk: int | None, workers: int) -> Parameter:
    if chunk is None:
        texts = [frames_text(each) for each in shared_out(frames, workers)]
    elif chunk < 1:
        raise UsageError("--chunk", str(chunk), "1 or more frames")
    else:
        texts = chunk_texts(frames, chunk)
    return Parameter(name=FRAMES, values=tuple(texts))


def shared_out(frames: Sequence[float], workers: int) -> list[Sequence[float]]:
    """Divide frames into tasks that keep workers busy, and that end at nearly the same time: the
    last ones are shorter (guided self-scheduling, Polychronopoulos and Kuck 1987)."""
    most = max(1, -(-len(frames) // (workers * TURNS)))
    parts: list[Sequence[float]] = []
    first = 0
    while first < len(frames):
        size = max(1, min(most, (len(frames) - first) // (2 * workers)))
        parts.append(frames[first : first + size])
        first += size
    return parts


def chunk_texts(frames: Sequence[float], chunk: int) -> list[str]:
    """Return ranges of at most `chunk` frames, as `parse_frames` reads them."""
    return [frames_text(frames[first : first + chunk]) for first in range(0, len(frames), chunk)]


def frames_text(frames: Sequence[float]) -> str:
    """Return frames as a range that `parse_frames` reads."""
    first, last = frames[0], frames[-1]
    if len(frames) > 1 and list(frames) == [first + i for i in range(len(frames))]:
        return f"{_number(first)}-{_number(last)}"
    return ",".join(map(_number, frames))


def _number(frame: float) -> str:
    """Return the shortest text without an exponent that is read as this frame."""
    text = format(Decimal(repr(float(frame))), "f")
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text == "-0" else text
