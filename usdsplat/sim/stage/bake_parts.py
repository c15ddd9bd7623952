"""The spans of the epochs of a bake, and where the samples of each are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from usdsplat.schema import tokens
from usdsplat.sim.stage.bake_layers import BakeLayers
from usdsplat.sim.stage.sample_layer import Part


def parts_of(
    layers: BakeLayers, times: Sequence[float], size: int, merged: int, epochs: int
) -> list[Part]:
    """Return the samples of each epoch.

    Args:
        layers: Files of the bake.
        times: All frames [time code].
        size: Frames of an epoch.
        merged: Number of epochs whose samples are in the file of a shorter bake.
        epochs: Number of epochs in all.
    """
    firsts = [-math.inf, *(times[size * number] for number in range(1, merged + 1))]
    earlier = [
        Part(path=layers.merged, first=first, end=end) for first, end in itertools.pairwise(firsts)
    ]
    return earlier + [Part(path=layers.clip(number)) for number in range(merged, epochs)]


def spans_of(
    times: Sequence[float], end: float, size: int, epochs: int
) -> list[tuple[float, float]]:
    """Return the first time of each clip, and of the one after it [time code].

    Args:
        times, size, epochs: As for `parts_of`.
        end: One frame after the last one [time code].
    """
    starts = [number * size for number in range(epochs)]
    firsts = [tokens.LONG_AGO, *times[1:], end]
    return [(firsts[start], firsts[min(start + size, len(times))]) for start in starts]
