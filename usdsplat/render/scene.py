"""Hold the splats, meshes and lights of one engine, without USD."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.core.extent import extent
from usdsplat.render.cropping import inside
from usdsplat.render.draw_list import DrawList, draw_list
from usdsplat.render.fields import Box, Drawn, DrawnMesh, Field, Mesh
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.lod.appearances import Laid
from usdsplat.render.lod.cache import NodeCache
from usdsplat.render.lod.tree import Tree, TreeSpec
from usdsplat.render.matte_groups import MatteGroups, matte_groups
from usdsplat.render.scene_subject import of_scene
from usdsplat.render.specs import CropSpec, FieldSpec, InstanceSpec, MeshSpec
from usdsplat.render.splat_budget import KEPT
from usdsplat.render.subject import Subject

SUBJECT = 0.004
"""Fraction of the splats, at either end of each axis, that may be outliers far from the subject."""

FEW = 100_000
"""Approximate number of splats that are sampled to find the subject."""


def matrix(numbers: tuple[float, ...]) -> F64:
    """Return a `specs.Matrix` as an array, shape (4, 4)."""
    return np.array(numbers, np.float64).reshape(4, 4)


def _place(box: Box, instances: tuple[InstanceSpec, ...]) -> Box:
    """Return the box around all instances of a box."""
    m = np.array([each.transform for each in instances]).reshape(-1, 4, 4)
    center = m[:, :3, :3] @ (0.5 * (box[0] + box[1])) + m[:, :3, 3]
    half = np.abs(m[:, :3, :3]) @ (0.5 * (box[1] - box[0]))
    return (center - half).min(axis=0), (center + half).max(axis=0)


def _extent(spec: FieldSpec | MeshSpec) -> Box | None:
    """Return the bounds in local space; None if nothing is finite."""
    if isinstance(spec, MeshSpec):
        return _box_of(spec.points)
    box = extent(spec.cloud)
    return None if box is None else (box[0], box[1])


def _box_of(points: F32) -> Box | None:
    """Return the box around all finite points."""
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        return None
    return points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)


def _subject(spec: FieldSpec | MeshSpec) -> Box | None:
    """Return the bounds of a mesh, or of a cloud's centres without outliers."""
    if isinstance(spec, MeshSpec):
        return _box_of(spec.points)
    return _most_of(spec.cloud.positions)


def _subject_of_tree(tree: Tree) -> Box:
    """Return the bounds of the centres without outliers, by the coarsest level, which is small."""
    if tree.subject is None:
        positions = [cloud.positions for cloud in tree.coarsest()]
        found = _most_of(np.concatenate(positions)) if positions else None
        tree.subject = found or tree.box
    return tree.subject


def _most_of(positions: F32 | F64) -> Box | None:
    """Return the box around all finite positions but outliers."""
    few = positions[:: max(1, len(positions) // FEW)]
    few = few[np.isfinite(few).all(axis=1)]
    if len(few) == 0:
        return None
    low, high = np.quantile(few, (SUBJECT, 1 - SUBJECT), axis=0)
    return low.astype(np.float64), high.astype(np.float64)


def _measured(thing: Field | Mesh, name: str, measure: Any) -> Any:
    """Return a box of a field or mesh, computed on first use."""
    if getattr(thing, name) is None:
        setattr(thing, name, measure(thing.spec))
    return getattr(thing, name)


def _joined(boxes: list[Box]) -> Box | None:
    """Return the box around all boxes; None if there are none."""
    if not boxes:
        return None
    lows, highs = zip(*boxes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _left_by_crops(field: Field) -> list[Box]:
    """Return the world box of the centres that the crops keep, without outliers, for each
    instance."""
    positions = field.spec.cloud.positions
    few = positions[:: max(1, len(positions) // FEW)].astype(np.float64)
    boxes = []
    for instance in field.instances:
        with np.errstate(all="ignore"):  # what is not finite is no part of the box
            world = few @ matrix(instance.transform)[:3, :3].T + matrix(instance.transform)[:3, 3]
        box = _most_of(world[inside(field.crops, world)])
        if box is not None:
            boxes.append(box)
    return boxes


class RenderScene:
    """Fields, trees, meshes and lights of a scene by prim path, with their transforms.

    Nothing is shared between scenes. `close` releases everything.
    """

    def __init__(self) -> None:
        self._fields: dict[str, Field] = {}
        self._trees: dict[str, Tree] = {}
        self.node_cache = NodeCache()
        """Splats of the trees' nodes."""
        self.laid: Laid | None = None
        """Layout of the last picture with trees."""
        self._meshes: dict[str, Mesh] = {}
        self._lights: dict[str, LightSpec] = {}
        self._drawn: list[Drawn] | None = None
        self._draw_lists: dict[int, DrawList] = {}
        self._matte_groups: dict[str, MatteGroups] = {}
        self._subject: tuple[Subject | None] | None = None

    # --- editing ---------------------------------------------------------------------------

    def set_field(self, path: str, spec: FieldSpec) -> None:
        """Add the field at `path`, or replace its splats."""
        self._forget_order()
        self.laid = None  # it has the splats of the field
        if path in self._fields:
            self._fields[path].replace(spec)
        else:
            self._fields[path] = Field(spec)

    def set_tree(self, path: str, spec: TreeSpec) -> None:
        """Add the splat tree at `path`, or replace it. What it has no more is dropped, and read
        again for other trees that have it."""
        self._forget_order()
        if path not in self._trees:
            self._trees[path] = Tree(spec)
            return
        gone = self._trees[path].spec.tokens - spec.tokens
        self._trees[path].replace(spec)
        if gone:
            self.laid = None
            self.node_cache.drop(lambda key: isinstance(key, tuple) and key[0] in gone)

    def set_mesh(self, path: str, spec: MeshSpec) -> None:
        """Add the mesh at `path`, or replace its triangles."""
        self._forget_order()
        mesh = self._meshes.get(path)
        if mesh is None:
            self._meshes[path] = Mesh(spec)
        else:
            mesh.spec, mesh.local, mesh.subject = spec, None, None

    def set_light(self, path: str, spec: LightSpec | None) -> None:
        """Add or replace the light at `path`, or remove it if `spec` is None."""
        self._lights.pop(path, None)
        if spec is not None:
            self._lights[path] = spec

    def set_crops(self, path: str, crops: tuple[CropSpec, ...]) -> None:
        """Set the crops that keep or remove splats of the field or tree at `path`."""
        self._forget_order()
        owner = self._trees.get(path) or self._fields[path]
        owner.crops = crops

    def set_instances(self, path: str, instances: tuple[InstanceSpec, ...]) -> None:
        """Set the instances of the field, tree or mesh at `path`."""
        self._forget_order()
        self._at(path).instances = instances

    def set_visible(self, path: str, visible: bool) -> None:
        """Show or hide the field, tree or mesh at `path`."""
        self._forget_order()
        self._at(path).visible = visible

    def remove(self, path: str) -> None:
        """Remove the field, tree or mesh at `path`."""
        self._forget_order()
        self.laid = None  # releases the nodes of trees
        for kind in (self._fields, self._trees, self._meshes):
            kind.pop(path, None)
        if not self._trees:
            self.node_cache.close()

    def close(self) -> None:
        """Release all arrays."""
        self._forget_order()
        self.laid = None
        self._fields.clear()
        self._trees.clear()
        self.node_cache.close()
        self._meshes.clear()
        self._lights.clear()

    # --- reading ---------------------------------------------------------------------------

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of all fields, trees and meshes, sorted."""
        return tuple(sorted((*self._fields, *self._trees, *self._meshes)))

    @property
    def lights(self) -> tuple[LightSpec, ...]:
        """All visible lights, by path."""
        named = self.named_lights
        return tuple(named[path] for path in sorted(named))

    @property
    def named_lights(self) -> Mapping[str, LightSpec]:
        """All visible lights by path."""
        return MappingProxyType({path: each for path, each in self._lights.items() if each.is_on})

    def light(self, path: str) -> LightSpec | None:
        """Return the light at `path`, visible or not; None if there is none."""
        return self._lights.get(path)

    def catchers(self) -> set[str]:
        """Return the paths of all drawn prims that are shadow catchers by themselves."""
        trees = {e.path for _, t in self.drawn_trees() if t.spec.is_catcher for e in t.instances}
        splats = {each.path for _, field, each in self.drawn() if field.spec.is_catcher}
        meshes = {each.path for _, mesh, each in self.drawn_meshes() if mesh.spec.is_catcher}
        return trees | splats | meshes

    @property
    def splat_count(self) -> int:
        """Number of splats of all captures; instances do not count."""
        trees = sum(tree.spec.captured for tree in self._trees.values())
        return trees + sum(len(field.spec.cloud) for field in self._fields.values())

    def visible_fields(self) -> list[Field]:
        """Return the fields that are drawn at least once."""
        return [field for field in self._fields.values() if field.is_drawn]

    @property
    def has_trees(self) -> bool:
        """Whether there are splat trees, visible or not."""
        return bool(self._trees)

    def tree(self, path: str) -> Tree | None:
        """Return the splat tree at `path`; None if there is none, or it was never visible."""
        return self._trees.get(path)

    def drawn_trees(self) -> list[tuple[str, Tree]]:
        """Return the trees that are drawn at least once, by path."""
        return sorted((path, tree) for path, tree in self._trees.items() if tree.is_drawn)

    def color_spaces(self) -> set[str]:
        """Return the training spaces of all visible splats."""
        trees = {tree.spec.color_space for _, tree in self.drawn_trees()}
        return trees | {field.spec.color_space for field in self.visible_fields()}

    def drawn(self) -> list[Drawn]:
        """Return each visible appearance of a field, by path, then index. This order breaks ties of
        depth."""
        if self._drawn is None:
            seen = [
                (path, field, instance)
                for path, field in self._fields.items()
                if field.is_drawn
                for instance in field.instances
            ]
            self._drawn = sorted(seen, key=lambda item: (item[2].path, item[2].index, item[0]))
        return self._drawn

    def drawn_meshes(self) -> list[DrawnMesh]:
        """Return each visible appearance of a mesh, by path, then index."""
        drawn = ((path, mesh) for path, mesh in self._meshes.items() if mesh.is_drawn)
        seen = [(path, mesh, instance) for path, mesh in drawn for instance in mesh.instances]
        return sorted(seen, key=lambda item: (item[2].path, item[2].index, item[0]))

    def prims(self) -> tuple[str, ...]:
        """Return the paths of all drawn prims, sorted. The number of a prim is its index here."""
        return self.draw_list().prims

    def draw_list(self, budget: int = 0) -> DrawList:
        """Return the visible fields, laid out for kernels. The result is cached until the next
        edit.

        What is drawn of a tree depends on the view, see `lod.nodes`. Here only its prims and the
        number of its splats are counted.

        Args:
            budget: Maximum number of splats; each instance counts. 0 for all.
        """
        if budget not in self._draw_lists:
            for other in [each for each in self._draw_lists if each][: 1 - KEPT]:
                del self._draw_lists[other]  # releases its splats
            found = draw_list(self.drawn(), self.other_prims(), budget=budget)
            trees = (tree for _, tree in self.drawn_trees())
            more = sum(len(tree.instances) * tree.spec.captured for tree in trees)
            self._draw_lists[budget] = replace(found, total=found.total + more)
        return self._draw_lists[budget]

    def other_prims(self) -> set[str]:
        """Return the paths of all drawn prims that are not fields."""
        trees = {each.path for _, tree in self.drawn_trees() for each in tree.instances}
        return trees | {instance.path for _, _, instance in self.drawn_meshes()}

    def matte_groups(self, layer: str) -> MatteGroups:
        """Return the groups of a layer of Cryptomatte. The result is cached until the next edit."""
        if layer not in self._matte_groups:
            trees = [each for _, tree in self.drawn_trees() for each in tree.instances]
            splats = [*(instance for _, _, instance in self.drawn()), *trees]
            self._matte_groups[layer] = matte_groups(
                layer, self.prims(), splats, self.drawn_meshes()
            )
        return self._matte_groups[layer]

    def bounds(self) -> Box | None:
        """Return the lowest and highest corner of everything visible, in the world. None if nothing
        is."""
        return self._union("local", _extent)

    def subject(self) -> Box | None:
        """Return the bounds of the subject: as `bounds`, but from splat centres and without
        outliers."""
        return self._union("subject", _subject)

    def seen(self, paths: tuple[str, ...] = ()) -> Subject | None:
        """Return a sample of what is visible, for cameras that frame it; None if nothing is.

        Args:
            paths: Only prims at or below these; empty for all, which is cached until the next edit.
        """
        if self._subject is None or paths:
            fields, trees = self.visible_fields(), [tree for _, tree in self.drawn_trees()]
            meshes = [mesh for mesh in self._meshes.values() if mesh.is_drawn]
            found = of_scene(fields, trees, meshes, paths)
            if paths:
                return found
            self._subject = (found,)
        return self._subject[0]

    def caster_bounds(self) -> tuple[Box | None, Box | None]:
        """Return the bounds of the visible splats, without outliers, and those of the meshes."""
        trees = [_place(_subject_of_tree(t), t.instances) for _, t in self.drawn_trees()]
        fields = [
            _place(box, field.instances)
            for field in self.visible_fields()
            if (box := _measured(field, "subject", _subject)) is not None
        ]
        meshes = [
            _place(box, mesh.instances)
            for mesh in self._meshes.values()
            if mesh.is_drawn and (box := _measured(mesh, "local", _extent)) is not None
        ]
        return _joined([*trees, *fields]), _joined(meshes)

    def subject_of(self, thing: Field | Mesh) -> Box | None:
        """Return the subject of one field or mesh in local space, ignoring its crops."""
        return _measured(thing, "subject", _subject)

    # --- private ---------------------------------------------------------------------------

    def _at(self, path: str) -> Field | Tree | Mesh:
        if path in self._trees:
            return self._trees[path]
        return self._fields[path] if path in self._fields else self._meshes[path]

    def _union(self, name: str, measure: Any) -> Box | None:
        boxes = [
            _place(_subject_of_tree(tree) if name == "subject" else tree.box, tree.instances)
            for _, tree in self.drawn_trees()
        ]
        meshes = [mesh for mesh in self._meshes.values() if mesh.is_drawn]
        things: list[Any] = [*self.visible_fields(), *meshes]
        for thing in things:
            if name == "subject" and isinstance(thing, Field) and thing.crops:
                boxes += _left_by_crops(thing)
                continue
            box = _measured(thing, name, measure)
            if box is not None:
                boxes.append(_place(box, thing.instances))
        return _joined(boxes)

    def _forget_order(self) -> None:
        self._drawn = None
        self._draw_lists.clear()
        self._matte_groups.clear()
        self._subject = None
