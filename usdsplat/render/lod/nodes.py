"""The nodes of splat trees that one picture draws: its cuts, their splats, and its samples."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.node_table import NodeTable
from usdsplat.render import sampling
from usdsplat.render.draw_list import DrawList, draw_list
from usdsplat.render.fields import Drawn, Field
from usdsplat.render.lod.cache import MIB, NodeCache, Request, Result
from usdsplat.render.lod.cut import Cut, choose
from usdsplat.render.lod.gathering import TimeSampler, gathered
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.sampling import Sample
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.spatial_order import StorageOrder
from usdsplat.render.specs import FieldSpec, View

Part = tuple[int, bool]
"""Node, and whether its proxies are meant; else its splats of the capture."""

PROXIES = ":proxies"
"""End of the name of proxies, which differs from that of the residents of the same node."""


@dataclass(frozen=True, slots=True, eq=False)
class _Appearance:
    """A field, or a part of a node, in one instance."""

    drawn: Drawn
    least: float = -math.inf
    """Samples draw it that refine nodes above this error [pixel], or a larger one,"""
    most: float = math.inf
    """but below this one."""


class PictureNodes:
    """The nodes of one picture. Their splats stay in memory as long as it exists.

    Args:
        sampler: Scene and view at a time relative to the picture's.
        plan: Samples of the picture.

    Raises:
        UsageError: If the splats take more memory than is allowed.
    """

    def __init__(
        self, sampler: TimeSampler, plan: Sequence[Sample], settings: RenderSettings
    ) -> None:
        self._settings = settings
        self._fades = settings.lod_samples > 1 or settings.samples > 1
        scene, screens, self._seen = gathered(sampler, plan)
        budget = settings.splat_budget
        self._cut, self._fields = self._loaded(
            scene.node_cache, screens, _tree_budget(scene, settings)
        )
        self._field_budget = max(1, budget - self._cut.splats) if budget else 0
        self._most = self._last_error(self._cut)
        tables = [each.spec.table for each in self._seen.values()]
        self.shows_inner = self._cut.shows_inner(tables, self._most)
        """Whether an inner node can be seen in any sample."""
        self._last: tuple[list[Drawn], set[str], DrawList | None] = [], set(), None

    @property
    def cut(self) -> Cut:
        """The cuts of all samples."""
        return self._cut

    def layout(self, scene: RenderScene, fade: float) -> DrawList:
        """Return the splats of one sample, laid out for kernels.

        Splats of captures come first, in the order that breaks ties: fields, and trees by node, in
        the order of their paths. Coarse levels follow. All samples have the same layout, so that
        work is shared between them; in each, the appearances that it does not draw are hidden.
        """
        appearances, others = self._appearances(scene), scene.other_prims()
        drawn = [each.drawn for each in appearances]
        before, prims, found = self._last
        if found is None or others != prims or not _is_same(drawn, before):
            found = draw_list(drawn, others, budget=self._field_budget)
            found = replace(found, total=scene.draw_list().total)
            self._last = drawn, others, found
        error = self._cut.error_at(fade)
        limits = np.array([(each.least, each.most) for each in appearances]).reshape(-1, 2)
        return found.hiding(~((limits[:, 0] <= error) & (error < limits[:, 1])))

    def drawn(self, scene: RenderScene) -> list[Drawn]:
        """Return each appearance of splats, in the order of the layout."""
        return [each.drawn for each in self._appearances(scene)]

    def _appearances(self, scene: RenderScene) -> list[_Appearance]:
        """Return what any sample draws, in the order of the layout."""
        found = [
            ((each[2].path, each[2].index, each[0]), [_Appearance(each)]) for each in scene.drawn()
        ]
        inner: list[_Appearance] = []
        present = dict(scene.drawn_trees())
        for (path, seen), reached in zip(self._seen.items(), self._cut.trees, strict=True):
            if present.get(path) is not seen.tree:
                continue
            instances = {
                row: each
                for each in seen.tree.instances
                if (row := seen.rows.get((each.path, each.index))) is not None
            }
            kept = reached.keeping(reached.seen)
            captured: list[_Appearance] = []
            for part, which in _parts(seen.spec, kept.nodes, kept.errors > self._most):
                field = self._fields.get((path, part))
                if field is None:
                    continue
                for row in which.tolist():
                    instance = instances.get(int(kept.instances[row]))
                    if instance is not None:
                        least = float(kept.errors[row]) if part[1] else -math.inf
                        drawn = f"{path}:{part[0]}{PROXIES if part[1] else ''}", field, instance
                        one = _Appearance(drawn, least, float(kept.above[row]))
                        (inner if part[1] else captured).append(one)
            if captured:
                first = captured[0].drawn[2]
                found.append(((first.path, first.index, path), captured))
        found.sort(key=lambda each: each[0])
        return [*(one for _, some in found for one in some), *inner]

    # --- private ---------------------------------------------------------------------------

    def _loaded(
        self, cache: NodeCache, screens: Sequence[Screen], budget: int
    ) -> tuple[Cut, dict[tuple[str, Part], Field]]:
        """Choose the cut and read it. If a node cannot be read, its parent is drawn in place of it
        and its siblings."""
        coarse: dict[str, set[int]] = {path: set() for path in self._seen}
        asked: set[Hashable] = set()
        while True:
            views = [each.view(coarse[path]) for path, each in self._seen.items()]
            cut = choose(views, screens, error=self._settings.lod_error, budget=budget)
            wanted = dict(self._wanted(cut))
            for path, seen in self._seen.items():  # others must not keep what the cache drops
                kept = {k: each for k, each in seen.tree.fields.items() if (path, k) in wanted}
                seen.tree.fields = kept
            results = self._read(cache, wanted, waits=self._settings.node_wait)
            asked.update(map(self._key, wanted))
            missing = wanted.keys() - results.keys()
            needed = {name: wanted[name] for name in missing if not self._replace(name, coarse)}
            results |= self._read(cache, needed, waits=True, keep=results)
            failed = {
                name: result
                for name, result in results.items()
                if isinstance(result, UsdSplatError)
            }
            if not self._give_up(failed) and len(missing) == len(needed):
                break
        cache.cancel_others(asked)
        fields = {
            name: self._field(name, result)
            for name, result in results.items()
            if isinstance(result, SplatCloud) and len(result)
        }
        return cut, fields

    def _wanted(self, cut: Cut) -> Iterator[tuple[tuple[str, Part], Request]]:
        """Yield the parts of nodes that any sample draws, and how to read them, those that replace
        the largest errors first."""
        urgent: dict[tuple[str, Part], float] = {}
        for (path, seen), reached in zip(self._seen.items(), cut.trees, strict=True):
            kept = reached.keeping(reached.seen)
            refined = kept.errors > self._last_error(cut)  # the others are drawn in some sample
            for part, rows in _parts(seen.spec, kept.nodes, refined):
                urgent[path, part] = float(kept.above[rows].max())
        for path, part in sorted(urgent, key=lambda name: (-urgent[name], name)):
            seen = self._seen[path]
            if part[0] in seen.tree.lost:
                continue
            spec = seen.spec
            first, count = _rows(spec, part)
            read = partial(spec.read, part[0], first, count)
            yield (path, part), Request(read=read, size=count * spec.splat_bytes)

    def _read(
        self,
        cache: NodeCache,
        wanted: dict[tuple[str, Part], Request],
        *,
        waits: bool,
        keep: Collection[tuple[str, Part]] = (),
    ) -> dict[tuple[str, Part], Result]:
        """Return the splats of parts of nodes, or why they cannot be read; those of `keep` stay in
        memory."""
        keys = {name: self._key(name) for name in wanted}
        found = cache.get(
            {keys[name]: request for name, request in wanted.items()},
            limit=self._settings.node_memory * MIB,
            lifetime=self._settings.node_lifetime,
            waits=waits,
            keep={self._key(name) for name in keep},
        )
        return {name: found[key] for name, key in keys.items() if key in found}

    def _replace(self, name: tuple[str, Part], coarse: dict[str, set[int]]) -> bool:
        """Draw a coarser node in place of one that is not in memory; return False if there is
        none."""
        path, (node, _) = name
        stand_in = _stand_in(self._seen[path].spec.table, node)
        if stand_in is not None:
            coarse[path].add(stand_in)
        return stand_in is not None

    def _last_error(self, cut: Cut) -> float:
        """Return the largest error [pixel] of an inner node that any sample draws."""
        return cut.error_at(1.0 if self._fades else 0.0)

    def _key(self, name: tuple[str, Part]) -> Hashable:
        """Return the key of a part of a node in the cache."""
        path, part = name
        spec = self._seen[path].spec
        return spec.key(part[0], *_rows(spec, part))

    def _give_up(self, failed: dict[tuple[str, Part], UsdSplatError]) -> bool:
        """Close the nodes above those that cannot be read. Return whether another cut is needed.

        A node with none above that could be drawn is left out.
        """
        changed = False
        for (path, (node, _)), error in failed.items():
            tree = self._seen[path].tree
            tree.problems[int(tree.spec.table.chunk[node])] = error
            stand_in = _stand_in(tree.spec.table, node)
            if stand_in is None or stand_in in tree.closed:
                tree.lost.add(node)
            else:
                tree.closed.add(stand_in)
            changed = True
        return changed

    def _field(self, name: tuple[str, Part], cloud: SplatCloud) -> Field:
        """Return a part of a node as a field of the draw list."""
        path, part = name
        tree, spec = self._seen[path].tree, self._seen[path].spec
        found = tree.fields.get(part)
        if found is None or found.spec.cloud is not cloud:
            node, is_inner = part
            found = tree.fields[part] = Field(
                spec=FieldSpec(
                    cloud=cloud,
                    color_space=spec.color_space,
                    rasterize_mode="antialiased" if is_inner else spec.rasterize_mode,
                    projection_mode=spec.projection_mode,
                    sorting_mode=spec.sorting_mode,
                    footprint=spec.footprint,
                    grade=spec.grade,
                ),
                crops=tree.crops,
                spatial_order=StorageOrder(),
                first_element=int(tree.elements[int(is_inner), node]),
                is_node=True,
                is_inner=is_inner,
            )
        return found


def view_cut(scene: RenderScene, view: View, settings: RenderSettings) -> Cut:
    """Return the cut of a view, without reading its nodes."""
    _, screens, seen = gathered(lambda _: (scene, view), (Sample(),))
    views = [each.view() for each in seen.values()]
    budget = _tree_budget(scene, settings)
    return choose(views, screens, error=settings.lod_error, budget=budget)


def samples_of(
    settings: RenderSettings, plan: tuple[Sample, ...], nodes: PictureNodes | None, along: int
) -> tuple[tuple[Sample, ...], ...]:
    """Return the samples of a picture, each repeated for coarse levels if it shows any.

    Args:
        plan: Samples of a picture without trees.
        along: Number of samples of these levels along each axis of a pixel.
    """
    if nodes is None or not nodes.shows_inner:
        return tuple((each,) for each in plan)
    if settings.display_mode in ("points", "ellipses"):
        along = 1  # their sizes are those of dots and outlines
    return sampling.subdivided(plan, settings, along)


def nodes_of(
    scene: RenderScene, sampler: TimeSampler, settings: RenderSettings, plan: Sequence[Sample]
) -> PictureNodes | None:
    """Return the nodes that a picture of a scene draws; None without splat trees."""
    return PictureNodes(sampler, plan, settings) if scene.has_trees else None


def _tree_budget(scene: RenderScene, settings: RenderSettings) -> int:
    """Return the splats that are left for trees if fields keep all of theirs; 0 for any number."""
    if not settings.splat_budget:
        return 0
    return max(1, settings.splat_budget - scene.draw_list().splats)


def _parts(
    spec: TreeSpec, nodes: np.ndarray, refined: np.ndarray
) -> Iterator[tuple[Part, np.ndarray]]:
    """Yield the parts of nodes that are drawn, and the rows of `nodes` at which each is.

    A leaf has one part, its splats and residents. An inner node has its residents, and its proxies
    if it is not refined.
    """
    table = spec.table
    order = np.argsort(nodes, kind="stable")
    starts = np.flatnonzero(np.diff(nodes[order], prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else ():
        node = int(nodes[rows[0]])
        if not table.child_count[node]:
            if table.proxies[node] + table.residents[node]:
                yield (node, False), rows
            continue
        if table.residents[node]:
            yield (node, False), rows
        if table.proxies[node] and not refined[rows].all():
            yield (node, True), rows[~refined[rows]]


def _stand_in(table: NodeTable, node: int) -> int | None:
    """Return the nearest node above that has proxies; None if there is none."""
    above = int(table.parents()[node])
    while above >= 0 and not table.proxies[above]:
        above = int(table.parents()[above])
    return above if above >= 0 else None


def _is_same(a: list[Drawn], b: list[Drawn]) -> bool:
    """Return whether two lists have the same fields and instances."""
    return len(a) == len(b) and all(
        x[1] is y[1] and (x[2] is y[2] or x[2] == y[2]) for x, y in zip(a, b, strict=True)
    )


def _rows(spec: TreeSpec, part: Part) -> tuple[int, int]:
    """Return the first row in its chunk and the number of rows of a part of a node."""
    (node, is_inner), table = part, spec.table
    first, proxies, residents = (
        int(each[node]) for each in (table.first_row, table.proxies, table.residents)
    )
    if not table.child_count[node]:
        return first, proxies + residents
    return (first, proxies) if is_inner else (first + proxies, residents)
