"""What may have changed about a prim, in Hydra's words.

The names are those of `HdChangeTracker` (and `HdCamera` for PARAMS); only bits that some prim here
listens to exist.
"""

from __future__ import annotations

from enum import IntFlag


class DirtyBits(IntFlag):
    """A set of aspects of one prim that must be pulled again."""

    CLEAN = 0
    PARAMS = 1 << 1
    """The lens of a camera."""
    PRIMVAR = 1 << 6
    """The splats of a field, and how it asks to be drawn."""
    TRANSFORM = 1 << 9
    """Where the prim, or an instancer that carries it, is."""
    VISIBILITY = 1 << 10
    INSTANCER = 1 << 16
    """The arrays of an instancer; of a field, those of an instancer that carries it."""
    INSTANCE_INDEX = 1 << 17
    """By which instances and prototypes a field is seen."""
    RENDER_TAG = 1 << 19
    """The purpose, or which purposes are wanted."""
    CATEGORIES = 1 << 21
    """The volumes that a field is cropped by: which collections hold them, and where they are."""
    ALL = (
        PARAMS
        | PRIMVAR
        | TRANSFORM
        | VISIBILITY
        | INSTANCER
        | INSTANCE_INDEX
        | RENDER_TAG
        | CATEGORIES
    )
