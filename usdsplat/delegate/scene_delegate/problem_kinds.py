"""Kinds of prims whose data could not be read."""

from __future__ import annotations

from usdsplat.delegate.scene_delegate.population import Population

UNREADABLE = {
    "field": "not-drawn",
    "mesh": "not-drawn",
    "instancer": "bad-instancer",
    "camera": "bad-camera",
    "light": "bad-light",
}
"""Kind of a prim -> code of the finding if it cannot be read."""


def is_in(population: Population, path: str, kind: str) -> bool:
    """Return whether the prim of a problem still exists with its kind."""
    prims = {
        "field": population.fields,
        "crops": population.fields,
        "values": population.fields,
        "mesh": population.meshes,
        "instancer": population.instancers,
        "camera": population.cameras,
        "lens": population.cameras,
        "light": population.lights,
    }
    if kind == "transforms":
        return path in population.fields or path in population.meshes
    return path in prims[kind]
