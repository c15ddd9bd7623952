"""The splats of a picture that receive light: fields, nodes of trees, and the cuts of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.lights.trees import Casters
from usdsplat.render.splat_normals import SurfaceValues

CUT = -1

Key = tuple[str, int]
"""Path of a tree, and the first element of the splats of a node or CUT; for a field an empty path
and the first slot of its group."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Target:
    """Splats of one group as receivers."""

    key: Key
    group: Group
    appearances: list[int]
    """Numbers of its instances among the casters."""
    surface: SurfaceValues
    version: Any
    """What their light depends on besides lights and casters."""
    whole: Target | None = None
    """The cut that lights see of a node's tree; None for others."""

    @property
    def is_cut(self) -> bool:
        """Whether these are the cut of a tree, of which only light without shadows is used."""
        return self.key[1] == CUT

    @property
    def capture(self) -> Target:
        """The receivers over which means of the capture are taken."""
        return self.whole or self


def targets_of(
    casters: Casters, layout: DrawList, groups: Sequence[Group], *, self_shadows: bool
) -> list[Target]:
    """Return groups of a layout as receivers; nodes of trees that cannot be read are none.

    Args:
        casters: All casters; with the cuts of trees if groups are nodes.
        layout: The splats that are drawn.
        groups: Some of its groups.
        self_shadows: Whether splats of a capture shadow each other.
    """
    trees, wholes = casters.trees, _wholes(casters, self_shadows)
    for path, tree in trees.items():
        tree.look_up([group.field for group in groups if group.field.tree == path])
    of_field, of_tree = _appearances(casters.layout, layout)
    found = []
    for group in groups:
        path = group.field.tree
        if not path:
            surface, numbers = group.field.surface_values(None), of_field[group.slot]
            version = _version(group, surface, self_shadows)
            found.append(
                Target(
                    key=(path, group.slot), group=group, appearances=numbers, surface=surface,
                    version=version,
                )
            )  # fmt: skip
        elif path in wholes:
            surface, numbers = trees[path].surface_of(group.field), of_tree[group.slot]
            version = *_version(group, surface, self_shadows), *numbers, wholes[path].version
            found.append(
                Target(
                    key=(path, group.field.first_element), group=group, appearances=numbers,
                    surface=surface, version=version, whole=wholes[path],
                )
            )  # fmt: skip
    return found


def _wholes(casters: Casters, self_shadows: bool) -> dict[str, Target]:
    """Return the cuts of trees as receivers, by path."""
    found = {}
    for group in casters.layout.groups:
        if path := group.field.tree:
            surface = casters.trees[path].surface
            found[path] = Target(
                key=(path, CUT), group=group,
                appearances=list(range(group.first, group.first + group.instances)),
                surface=surface, version=_version(group, surface, self_shadows),
            )  # fmt: skip
    return found


def _version(group: Group, surface: SurfaceValues, self_shadows: bool) -> tuple[Any, ...]:
    return group.field.shapes, surface, group.placements.transforms.tobytes(), self_shadows


def _appearances(
    casters: DrawList, layout: DrawList
) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
    """Return the numbers among the casters of the instances of each group of a field, and of each
    node of a tree, by its first slot."""
    numbers: dict[int, list[int]] = {}
    of_tree: dict[tuple[str, str, int], int] = {}
    for group in casters.groups:
        own = range(group.first, group.first + group.instances)
        numbers.setdefault(id(group.field), []).extend(own)
        for number in own if group.field.is_node else ():
            prim, index = casters.labels[number].tolist()
            of_tree[group.field.tree, casters.prims[prim], index] = number
    of_field, of_node = {}, {}
    for group in layout.groups:
        path = group.field.tree
        if not path:
            own_numbers, count = numbers[id(group.field)], group.instances
            of_field[group.slot], numbers[id(group.field)] = (
                own_numbers[:count], own_numbers[count:],
            )  # fmt: skip
            continue
        labels = layout.labels[group.appearances].tolist()
        names = [(path, layout.prims[prim], index) for prim, index in labels]
        if all(name in of_tree for name in names):
            of_node[group.slot] = [of_tree[name] for name in names]
    return of_field, of_node
