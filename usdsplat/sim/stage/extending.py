"""Add frames to a finished bake: from the checkpoint at the first frame of its last epoch.

The samples of earlier epochs stay; the last epoch is simulated and written again, because its last
frame was written as the end of the bake. The result has the bytes of a bake of all frames at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdsplat.core.errors import StageError
from usdsplat.sim import checkpoint as checkpoints
from usdsplat.sim.checkpoint import Checkpoint
from usdsplat.sim.stage.provenance import Provenance

EARLY = "endedEarly"
"""Entry of the record of a bake that has fewer frames than were asked for, as it was stopped."""
MERGED = "mergedEpochs"
"""Entry of the record of a bake that frames are being added to: epochs whose samples are in the
file of the shorter bake."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extension:
    """A finished bake, and the state to continue it from."""

    start: Checkpoint
    completed: int
    """Frames of the shorter bake."""


def last_epoch(frames: int, size: int) -> int:
    """Return the index of the first frame of the last epoch."""
    return (frames - 1) // size * size


def is_shorter(known: Mapping[str, Any], times: Sequence[float]) -> bool:
    """Return whether the frames of a bake are the first ones of `times`, and not all of them."""
    span = list(known.get("frameRange", ()))
    return len(span) == 2 and span[0] == times[0] and span[1] in times[:-1]


def extension(
    target: Path,
    kept: Path,
    known: Mapping[str, Any],
    provenance: Provenance,
    times: Sequence[float],
    start_hash: str,
) -> Extension:
    """Check that frames can be added to a finished bake, and read its checkpoint.

    Args:
        target: The named layer.
        kept: The checkpoint.
        known: Its record.
        provenance: What the longer bake is made of.
        times: All frames of the longer bake.
        start_hash: Hash of the parameters up to the first frame of the last epoch.

    Raises:
        StageError: If the bake was made of something else, has no checkpoint, or later frames need
            what it was not prepared for.
        FormatError: If the checkpoint is damaged.
    """
    provenance.check(target, known, without=("frameRange", "paramHash"))
    first, last = known["frameRange"]
    if not kept.exists():
        found = f"a bake without {kept.parent.name}/{kept.name}, from which frames are added"
        raise StageError(str(target), found, f"the frames {first:g}:{last:g}, or a new bake")
    lacking = set(provenance.features) - set(known.get("features", ()))
    if lacking:
        found = f"frames that need more than {first:g}:{last:g} ({min(lacking)})"
        raise StageError(f"{target}, extended", found, "a new bake of all frames")
    start = checkpoints.load(kept)
    if start.parameter_hash != start_hash:
        expected = "those that the bake was started with (--set too), or a new bake"
        raise StageError(f"{target}, extended", "other parameters", expected)
    return Extension(start=start, completed=times.index(float(last)) + 1)
