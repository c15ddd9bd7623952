"""Kinds of prims whose data could not be read."""

from __future__ import annotations

UNREADABLE = {
    "field": "not-drawn",
    "tree": "broken-tree",
    "mesh": "not-drawn",
    "instancer": "bad-instancer",
    "camera": "bad-camera",
    "light": "bad-light",
}
"""Kind of a prim -> code of the finding if it cannot be read."""
