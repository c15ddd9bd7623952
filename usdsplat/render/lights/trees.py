"""Splat trees as lights see them: a cut of their own, which does not depend on the view.

The nodes that a picture draws follow the camera, and would change shadows with it. So each tree has
one cut that casts shadows, the finest of a number of splats. Normals and the light of photographs
are computed once, on this cut. The nodes of a picture look them up at their own splats: the result
is the same wherever a chunk begins, and hardly changes where a node is refined.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.edit import merge
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.node_cuts import NodeCut, budget_cut, refined_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.render.draw_list import DrawList, draw_list
from usdsplat.render.fields import Drawn, Field
from usdsplat.render.lod.cache import THREADS
from usdsplat.render.lod.stand_ins import stand_ins
from usdsplat.render.lod.tree import Tree, TreeSpec
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import FieldSpec
from usdsplat.render.splat_normals import SurfaceValues, surface_values

TREE_SPLATS = 1 << 18
"""Most splats of the cut of one tree. Computing their normals takes about 5 s."""
ALL_SPLATS = 1 << 20
"""Most splats of the cuts of all trees; each instance counts."""
NEIGHBORS = 4
"""Number of splats of the cut of which a splat of a node takes the mean normal."""

_Rows = tuple[int, int, int]
"""Node, first row in its chunk, and number of rows."""


@dataclass(slots=True, eq=False)
class LitTree:
    """The cut of a tree that lights see, with what is computed from it."""

    content: tuple[Any, ...]
    """What the splats depend on."""
    spec: TreeSpec
    splats: Field
    surface: SurfaceValues
    problems: dict[int, UsdSplatError]
    """Chunk -> why splats of the cut could not be read."""
    nodes: dict[int, tuple[SplatCloud, SurfaceValues]] = field(default_factory=dict)
    """First element of a node's field -> its splats and their normals."""

    def look_up(self, nodes: Sequence[Field]) -> None:
        """Compute the normals of the splats of nodes, those of the nearest ones of the cut. Other
        nodes are dropped."""
        wanted = {node.first_element: node.spec.cloud for node in nodes}
        self.nodes = {key: held for key, held in self.nodes.items() if held[0] is wanted.get(key)}
        missing = {key: cloud for key, cloud in wanted.items() if key not in self.nodes}
        if not missing:
            return
        queries = np.concatenate([cloud.positions for cloud in missing.values()])
        found = looked_up(self.surface, self.splats.spec.cloud.positions, queries)
        first = 0
        for key, cloud in missing.items():
            rows = slice(first, first + len(cloud))
            part = SurfaceValues(found.normals[rows].copy(), found.facts[rows].copy())
            self.nodes[key], first = (cloud, part), rows.stop

    def surface_of(self, node: Field) -> SurfaceValues:
        """Return the normals of the splats of a node that has been looked up."""
        return self.nodes[node.first_element][1]


@dataclass(slots=True, eq=False)
class TreeStore:
    """What is kept of trees between pictures."""

    lit: dict[str, LitTree] = field(default_factory=dict)
    laid: tuple[tuple[Any, ...], DrawList] | None = None
    """What the layout of all casters depends on, and the layout."""


@dataclass(frozen=True, slots=True, eq=False)
class Casters:
    """All splats that cast shadows."""

    drawn: list[Drawn]
    layout: DrawList
    trees: dict[str, LitTree]


def cut_size(scene: RenderScene) -> int:
    """Return the most splats that lights see of each tree. It does not depend on the splat budget,
    which changes with each movement of a camera."""
    count = sum(len(tree.instances) for _, tree in scene.drawn_trees())
    return max(1, min(TREE_SPLATS, ALL_SPLATS // max(1, count)))


def casters_of(
    scene: RenderScene, settings: RenderSettings, store: TreeStore, *, reads: bool = True
) -> Casters:
    """Return what casts shadows: the splats of fields, and the cuts of trees.

    Args:
        reads: Whether cuts that are not kept are read; else their trees cast no shadows.
    """
    most = cut_size(scene)
    fields = scene.draw_list(settings.splat_budget)
    trees, drawn = {}, list(scene.drawn())
    for path, tree in scene.drawn_trees():
        found = _held(tree, most, store.lit.get(path))
        if found is None and reads:
            found = _lit(path, tree, most)
        if found is None:
            continue
        trees[path] = found
        drawn += [(path, found.splats, each) for each in tree.instances]
    if reads:
        store.lit = trees
    if not trees:
        return Casters(drawn, fields, trees)
    key = (fields, *(each for row in drawn for each in row[1:]))
    laid = store.laid
    if laid is None or not _same(laid[0], key):
        laid = key, draw_list(drawn, scene.other_prims(), budget=settings.splat_budget)
        store.laid = laid
    return Casters(drawn, laid[1], trees)


def looked_up(surface: SurfaceValues, positions: F32, queries: F32) -> SurfaceValues:
    """Return normals and facts at points: means of the nearest splats, by inverse squared distance.

    Args:
        surface: Normals of splats.
        positions: Centres of these splats, shape (n, 3).
        queries: Shape (m, 3). One of the centres has the values of its splat.
    """
    rows, distances = nearest(open_device("cpu"), positions, queries, NEIGHBORS)
    square = distances.astype(np.float64) ** 2  # infinite where there are fewer splats
    weights = 1.0 / np.maximum(square, 1e-300)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
    normals = np.einsum("mk,mkc->mc", weights, surface.normals[rows])
    facts = np.einsum("mk,mkc->mc", weights, surface.facts[rows])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), 0.0)
    return SurfaceValues(normals.astype(np.float32), facts.astype(np.float32))


# --- private ---------------------------------------------------------------------------------


def _content(spec: TreeSpec, most: int) -> tuple[Any, ...]:
    """Return what the splats of a cut depend on."""
    return spec.table, spec.chunks, {node: each[0] for node, each in spec.live.items()}, most


def _held(tree: Tree, most: int, held: LitTree | None) -> LitTree | None:
    """Return a cut that is kept, with the present values of its tree; None if it is another one."""
    spec = tree.spec
    if held is None or held.content != _content(spec, most):
        return None
    if held.spec is not spec:
        held.spec = spec
        held.splats.replace(_field_spec(spec, held.splats.spec.cloud))
    held.splats.crops = tree.crops
    tree.problems |= held.problems
    return held


def _lit(path: str, tree: Tree, most: int) -> LitTree | None:
    """Read the cut of a tree, and compute its normals; None without splats."""
    spec = tree.spec
    clouds, problems = _read(spec, most)
    tree.problems |= problems
    if not clouds:
        return None
    found = _field_spec(spec, merge(clouds))
    own = Field(spec=found, crops=tree.crops, tree=path)
    return LitTree(_content(spec, most), spec, own, surface_values(found), problems)


def _field_spec(spec: TreeSpec, cloud: SplatCloud) -> FieldSpec:
    return FieldSpec(
        cloud=cloud,
        color_space=spec.color_space,
        projection_mode=spec.projection_mode,
        captured_lights=spec.captured_lights,
    )


def _read(spec: TreeSpec, most: int) -> tuple[list[SplatCloud], dict[int, UsdSplatError]]:
    """Return the splats of the finest cut of so many, and why chunks could not be read. Coarser
    nodes stand for those, as in a picture, which may not draw them itself."""
    table, refined = spec.table, np.zeros(len(spec.table), np.bool_)
    refined[budget_cut(table, most).above] = True
    clouds: dict[_Rows, SplatCloud | UsdSplatError] = {}
    while True:
        cut = refined_cut(table, refined)
        parts = [part for part in _parts(table, cut) if part[2]]
        missing = [part for part in parts if part not in clouds]
        with ThreadPoolExecutor(THREADS, thread_name_prefix="cut") as pool:
            clouds.update(zip(missing, pool.map(partial(_cloud, spec), missing), strict=True))
        failed = [part[0] for part in missing if isinstance(clouds[part], UsdSplatError)]
        above = {next(stand_ins(table, node), -1) for node in failed} - {-1}
        if not any(refined[node] for node in above):
            break
        refined[list(above)] = False
    problems = {
        int(table.chunk[node]): error
        for (node, _, _), error in clouds.items()
        if isinstance(error, UsdSplatError)
    }
    return [each for part in parts if isinstance(each := clouds[part], SplatCloud)], problems


def _parts(table: NodeTable, cut: NodeCut) -> list[_Rows]:
    """Return what a cut draws: whole nodes, and residents of those above."""
    first, above = table.first_row, table.first_row + table.proxies
    whole = [(node, int(first[node]), int(table.sizes[node])) for node in cut.nodes.tolist()]
    return whole + [
        (node, int(above[node]), int(table.residents[node])) for node in cut.above.tolist()
    ]


def _cloud(spec: TreeSpec, rows: _Rows) -> SplatCloud | UsdSplatError:
    """Return rows of a node, or why they cannot be read."""
    try:
        return spec.read(*rows)
    except UsdSplatError as error:
        return error


def _same(before: tuple[Any, ...], now: tuple[Any, ...]) -> bool:
    """Return whether these are the same objects."""
    return len(before) == len(now) and all(a is b for a, b in zip(before, now, strict=True))
