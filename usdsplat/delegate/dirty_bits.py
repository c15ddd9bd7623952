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
    """The lens of a camera; what a light sends out."""
    DISPLAY_STYLE = 1 << 4
    """How often surfaces are refined."""
    POINTS = 1 << 5
    """Where the points of a mesh are, and all that moves them: skeletons, blend shapes."""
    PRIMVAR = 1 << 6
    """The splats of a field, and how it asks to be drawn; colours and coordinates of a mesh."""
    MATERIAL_ID = 1 << 7
    """Which materials a mesh is bound to, face by face, and what those are."""
    TOPOLOGY = 1 << 8
    TRANSFORM = 1 << 9
    """Where the prim, or an instancer that carries it, is."""
    VISIBILITY = 1 << 10
    NORMALS = 1 << 11
    DOUBLE_SIDED = 1 << 12
    INSTANCER = 1 << 16
    """The arrays of an instancer; of an rprim, those of an instancer that carries it."""
    INSTANCE_INDEX = 1 << 17
    """By which instances and prototypes an rprim is seen."""
    RENDER_TAG = 1 << 19
    """The purpose, or which purposes are wanted."""
    CATEGORIES = 1 << 21
    """The volumes that a field is cropped by: which collections hold them, and where they are."""
    PLACING = TRANSFORM | VISIBILITY | INSTANCE_INDEX | RENDER_TAG
    """Where an rprim is seen."""
    SURFACE = DISPLAY_STYLE | POINTS | PRIMVAR | MATERIAL_ID | TOPOLOGY | NORMALS | DOUBLE_SIDED
    """All that a mesh looks like."""
    ALL = PARAMS | SURFACE | PLACING | INSTANCER | CATEGORIES
