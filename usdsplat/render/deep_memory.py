"""Estimate the memory that ids and merging add to a deep picture."""

from __future__ import annotations

from usdsplat.render.deep_merging import HELD, merges_deep
from usdsplat.render.settings import RenderSettings

ID = 24
"""Bytes per deep sample and id: 4 in each of the arrays, in their channel, and in rows that are
being written; ids are found from samples that are drawn a second time."""
ENTRY = 40
"""Bytes per contribution that is held while samples are merged: 20 in its list, 20 in the list that
it is joined to. Each id takes 8 more."""


def deep_bytes(settings: RenderSettings, ids: int, samples: int) -> int:
    """Return the bytes per pixel of a strip.

    Args:
        ids: Number of ids of each sample.
        samples: Mean number of samples in a pixel.
    """
    held = HELD * (ENTRY + 8 * ids) if merges_deep(settings, ids) else 0
    return samples * ID * ids + held
