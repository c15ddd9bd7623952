"""Estimate the memory of a deep picture's samples."""

from __future__ import annotations

from dataclasses import dataclass

from usdsplat.render.band import BAND_PIXELS
from usdsplat.render.deep_merging import ENTRIES, HELD, merges_deep
from usdsplat.render.settings import RenderSettings

SAMPLES = 48
"""Mean number of samples in a deep pixel, for a dense capture that fills the picture."""
SAMPLE = 80
"""Bytes per deep sample: 24 in arrays, 24 in the copy with surfaces, 24 in the previous strip that
the caller still holds, 8 in rows that are being written."""
BEAUTY = 32
"""Bytes per deep sample whose colour is scaled to the beauty: the scaled colour, and its factor."""
ID = 24
"""Bytes per deep sample and id: 4 in each of the arrays, in their channel, and in rows that are
being written; ids are found from samples that are drawn a second time."""
ENTRY = 40
"""Bytes per contribution that is held while samples are merged: 20 in its list, 20 in the list that
it is joined to. Each id takes 8 more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeepSize:
    """Size of what is held of a deep picture at a time."""

    band_pixels: int = BAND_PIXELS
    """Approximate number of pixels of a band."""
    entries: int = ENTRIES
    """Maximum number of contributions that are held while they are merged."""


USUAL_SIZE = DeepSize()
"""Size without a memory limit."""


def deep_bytes(settings: RenderSettings, ids: int) -> int:
    """Return the bytes per pixel of a strip.

    Args:
        ids: Number of ids of each sample.
    """
    held = HELD * _entry(ids) if merges_deep(settings, ids) else 0
    return SAMPLES * _sample(settings, ids) + held


def entries_within(settings: RenderSettings, ids: int, size: int) -> int:
    """Return the number of contributions that fit in `size` bytes, if each becomes a sample."""
    return max(1, size // (_entry(ids) + _sample(settings, ids)))


def _entry(ids: int) -> int:
    return ENTRY + 8 * ids


def _sample(settings: RenderSettings, ids: int) -> int:
    return SAMPLE + ID * ids + BEAUTY * (settings.deep_color == "beauty")
