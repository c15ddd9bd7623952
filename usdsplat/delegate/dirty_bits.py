"""Dirty bits: aspects of a prim that may have changed, with Hydra's names.

The names are those of `HdChangeTracker` (and of `HdCamera` for PARAMS); only bits that some prim
here uses exist.
"""

from __future__ import annotations

from enum import IntFlag


class DirtyBits(IntFlag):
    """A set of aspects of one prim that must be pulled again."""

    CLEAN = 0
    PARAMS = 1 << 1
    """The lens of a camera; the emission of a light."""
    DISPLAY_STYLE = 1 << 4
    """The refinement level of surfaces."""
    POINTS = 1 << 5
    """The points of a mesh, and skeletons and blend shapes that move them."""
    PRIMVAR = 1 << 6
    """The splats and rendering hints of a field; primvars of a mesh."""
    MATERIAL_ID = 1 << 7
    """The materials of a mesh and their bindings by face."""
    TOPOLOGY = 1 << 8
    """The faces of a mesh; the nodes and chunks of a splat tree."""
    TRANSFORM = 1 << 9
    """The transform of the prim or of an instancer that carries it."""
    VISIBILITY = 1 << 10
    NORMALS = 1 << 11
    DOUBLE_SIDED = 1 << 12
    INSTANCER = 1 << 16
    """The arrays of an instancer; for an rprim, those of an instancer that carries it."""
    INSTANCE_INDEX = 1 << 17
    """The instances and prototypes through which an rprim appears."""
    RENDER_TAG = 1 << 19
    """The purpose, or the set of drawn purposes."""
    CATEGORIES = 1 << 21
    """The crop volumes of a field: members of the collections, and transforms."""
    PLACING = TRANSFORM | VISIBILITY | INSTANCE_INDEX | RENDER_TAG
    """The bits of an rprim's placements."""
    SURFACE = DISPLAY_STYLE | POINTS | PRIMVAR | MATERIAL_ID | TOPOLOGY | NORMALS | DOUBLE_SIDED
    """The bits of a mesh's surface."""
    ALL = PARAMS | SURFACE | PLACING | INSTANCER | CATEGORIES
