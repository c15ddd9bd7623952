"""Update the render index after a new traversal of the stage."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.scene_delegate.population import Population, RprimEntry

SEEN = DirtyBits.PLACING
"""Dirty bits of a field or a mesh whose appearances changed."""


def reconcile(index: RenderIndex, old: Population, new: Population) -> None:
    """Insert, remove and mark prims of `index`, which holds those of `old`."""
    gone = old.fields.keys() - new.fields.keys()
    retyped = {
        path
        for path in old.fields.keys() & new.fields.keys()
        if old.fields[path].is_tree != new.fields[path].is_tree
    }
    for path in gone | retyped:
        index.remove_field(path)
    for path in old.meshes.keys() - new.meshes.keys():
        index.remove_mesh(path)
    for path in old.instancers.keys() - new.instancers.keys():
        index.remove_instancer(path)
    for path in old.cameras.keys() - new.cameras.keys():
        index.remove_camera(path)
    for path in old.lights.keys() - new.lights.keys():
        index.remove_light(path)
    for path in sorted(new.instancers.keys() - old.instancers.keys()):
        index.insert_instancer(path)
    for path in sorted(new.cameras.keys() - old.cameras.keys()):
        index.insert_camera(path)
    for path in sorted(new.lights.keys() - old.lights.keys()):
        index.insert_light(path)
    for path in sorted((new.fields.keys() - old.fields.keys()) | retyped):
        if new.fields[path].is_tree:
            index.insert_tree(path)
        else:
            index.insert_field(path)
    for path in sorted(new.meshes.keys() - old.meshes.keys()):
        index.insert_mesh(path)
    for before, after in ((old.fields, new.fields), (old.meshes, new.meshes)):
        for path in before.keys() & after.keys():
            index.tracker.mark(path, _difference(before[path], after[path]))
    _carry(index, new)


def _difference(old: RprimEntry, new: RprimEntry) -> DirtyBits:
    """Return the dirty bits of an rprim whose entry changed."""
    if old.signature[0] != new.signature[0]:
        return DirtyBits.ALL
    bits = DirtyBits.CLEAN if old.signature == new.signature else SEEN
    same_crop = old.crop.signature == new.crop.signature
    return bits if same_crop else bits | DirtyBits.CATEGORIES


def _carry(index: RenderIndex, population: Population) -> None:
    """Set the rprims that each instancer carries in the tracker."""
    carried: dict[str, set[str]] = {path: set() for path in population.instancers}
    for path, entry in population.rprims():
        for appearance in entry.appearances:
            for link in appearance.placement.links:
                carried[link.instancer].add(path)
    for instancer, paths in carried.items():
        index.tracker.carry(instancer, paths)
