"""The nodes of splat trees that one picture draws: its cuts, their splats, and its samples."""

from __future__ import annotations

import operator
from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.node_table import NodeTable
from usdsplat.render import sampling
from usdsplat.render.draw_list import DrawList, laid_out
from usdsplat.render.fields import Drawn, Field
from usdsplat.render.lod.appearances import (
    Appearances,
    Gatherer,
    Laid,
    Part,
    Parts,
)
from usdsplat.render.lod.cache import NodeCache, Request, Result, check_limit
from usdsplat.render.lod.cut import Cut, Reached, choose
from usdsplat.render.lod.gathering import TimeSampler, gathered
from usdsplat.render.lod.measure import Bools
from usdsplat.render.lod.stand_ins import closing, replaced_errors, stand_ins
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.sampling import Sample
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.spatial_order import StorageOrder
from usdsplat.render.specs import FieldSpec, View

Name = tuple[str, Part]
"""Path of a tree, and a part of it."""
Wanted = dict[Name, tuple[Hashable, Request]]
"""Parts of nodes, with their keys in the cache and how to read them."""


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
        scene, screens, self._seen = gathered(sampler, plan, sampling.reach(settings))
        budget = settings.splat_budget
        self._parts: list[tuple[Parts, Parts]] = []
        """What any sample draws of each tree."""
        self.missing = 0
        """Number of parts of nodes that coarser ones replace until they are read."""
        self._cut, self._fields = self._loaded(scene, screens, _tree_budget(scene, settings))
        self._field_budget = max(1, budget - self._cut.splats) if budget else 0
        self._most = self._cut.error_at(1.0)
        tables = [each.spec.table for each in self._seen.values()]
        self.shows_inner = self._cut.shows_inner(tables, self._most)
        """Whether an inner node can be seen in any sample."""
        self._last: tuple[list[Any], Appearances | None] = [], None
        """The objects of the scene that the last appearances depend on, and these."""

    @property
    def cut(self) -> Cut:
        """The cuts of all samples."""
        return self._cut

    def layout(self, scene: RenderScene, fade: tuple[float, float]) -> DrawList:
        """Return the splats of one sample, laid out for kernels.

        Splats of captures come first, in the order that breaks ties: fields, and trees by node, in
        the order of their paths. Coarse levels follow. All samples have the same layout, so that
        work is shared between them; in each, appearances are faded or hidden.

        Args:
            fade: See `Sample.fade`.
        """
        found = self._appearances(scene)
        others, budget, last = scene.other_prims(), self._field_budget, scene.laid
        if last is None or not last.is_of(found, others, budget):
            layout = laid_out(
                found.fields, found.counts, found.instances, found.placed, others, budget=budget
            )
            layout = replace(layout, total=scene.draw_list().total)
            last = scene.laid = Laid(found, others, budget, layout)
        reached, replaced = (self._cut.refined(each, fade) for each in (found.above, found.errors))
        return last.layout.fading(np.maximum(reached - replaced, 0))

    def drawn(self, scene: RenderScene) -> list[Drawn]:
        """Return each appearance of splats, in the order of the layout."""
        return list(self._appearances(scene).drawn())

    def _appearances(self, scene: RenderScene) -> Appearances:
        """Return what any sample draws, in the order of the layout."""
        present, drawn = dict(scene.drawn_trees()), scene.drawn()
        given: list[Any] = [drawn]
        for tree in present.values():
            given += tree, tree.instances, tree.spec.grade, tree.crops
        before, last = self._last
        is_known = len(given) == len(before) and all(map(operator.is_, given, before))
        if last is not None and is_known:
            return last
        found = Gatherer(drawn)
        for (path, seen), parts in zip(self._seen.items(), self._parts, strict=True):
            if present.get(path) is not seen.tree:
                continue
            self._refresh(path)
            placed = {(each.path, each.index): each for each in seen.tree.instances}
            instances = [placed.get(name) for name in seen.rows]
            fields = self._fields[path]
            for each in parts:
                found.add_parts(path, each, instances, fields.get)
        last = found.finish()
        self._last = given, last
        return last

    # --- private ---------------------------------------------------------------------------

    def _refresh(self, path: str) -> None:
        """Give the fields of a tree the grade and the crops that it has now: they may change
        between samples. Unchanged fields stay the same objects."""
        tree, fields = self._seen[path].tree, self._fields[path]
        for part, each in fields.items():
            if each.spec.grade != tree.spec.grade or each.crops != tree.crops:
                spec = replace(each.spec, grade=tree.spec.grade)
                fields[part] = tree.fields[part] = replace(each, spec=spec, crops=tree.crops)

    def _loaded(
        self, scene: RenderScene, screens: Sequence[Screen], budget: int
    ) -> tuple[Cut, dict[str, dict[Part, Field]]]:
        """Choose the cut and read it. If a node cannot be read, its parent is drawn in place of it
        and its siblings."""
        while True:
            views = [each.view() for each in self._seen.values()]
            cut = choose(views, screens, error=self._settings.lod_error, budget=budget)
            ahead: Wanted = {}
            wanted = self._wanted(cut)
            if not self._settings.node_wait:
                check_limit((each for _, each in wanted.values()), self._settings.node_bytes)
                cut, wanted, ahead = self._in_memory(scene.node_cache, cut, wanted)
            self._release(scene, wanted)
            results = self._read(scene.node_cache, wanted, ahead)
            failed = {
                name: result
                for name, result in results.items()
                if isinstance(result, UsdSplatError)
            }
            if not self._give_up(failed):
                break
        fields: dict[str, dict[Part, Field]] = {path: {} for path in self._seen}
        for (path, part), result in results.items():
            if isinstance(result, SplatCloud) and len(result):
                fields[path][part] = self._field(path, part, result)
        return cut, fields

    def _release(self, scene: RenderScene, wanted: Wanted) -> None:
        """Release the fields of other nodes: they must not keep what the cache drops."""
        for path, seen in self._seen.items():
            fields = seen.tree.fields
            seen.tree.fields = {
                part: each for part, each in fields.items() if (path, part) in wanted
            }
        if scene.laid is not None:
            kept = {id(each) for seen in self._seen.values() for each in seen.tree.fields.values()}
            if any(each.is_node and id(each) not in kept for each in scene.laid.appearances.fields):
                scene.laid = None

    def _wanted(self, cut: Cut) -> Wanted:
        """Return the parts of nodes that any sample draws, those that replace the largest errors
        first, with their keys in the cache and how to read them."""
        most = cut.error_at(1.0)
        self._parts = [
            _parts(seen.spec.table, reached.keeping(reached.seen), most)
            for seen, reached in zip(self._seen.values(), cut.trees, strict=True)
        ]
        names: list[Name] = []
        urgent = [np.empty(0)]
        for path, both in zip(self._seen, self._parts, strict=True):
            for parts in both:
                names += [(path, (node, parts.is_inner)) for node in parts.nodes.tolist()]
                urgent.append(parts.urgency)
        ranked = np.argsort(-np.concatenate(urgent), kind="stable").tolist()
        return {
            names[rank]: self._request(names[rank])
            for rank in ranked
            if names[rank][1][0] not in self._seen[names[rank][0]].tree.lost
        }

    def _request(self, name: Name) -> tuple[Hashable, Request]:
        """Return the key of a part of a node in the cache, and how to read it."""
        path, part = name
        tree, spec = self._seen[path].tree, self._seen[path].spec
        found = tree.requests.get(part)
        if found is None:
            first, count = _rows(spec, part)
            read = partial(spec.read, part[0], first, count)
            request = Request(read=read, size=count * spec.splat_bytes)
            found = tree.requests[part] = spec.key(part[0], first, count), request
        return found

    def _read(self, cache: NodeCache, wanted: Wanted, ahead: Wanted) -> dict[Name, Result]:
        """Return the splats of parts of nodes, or why they cannot be read; `ahead` are read in the
        meantime."""
        found = cache.get(
            dict(wanted.values()),
            limit=self._settings.node_bytes,
            lifetime=self._settings.node_lifetime,
            ahead=dict(ahead.values()),
        )
        return {name: found[key] for name, (key, _) in wanted.items()}

    def _in_memory(self, cache: NodeCache, cut: Cut, wanted: Wanted) -> tuple[Cut, Wanted, Wanted]:
        """Replace the nodes of a cut that are not in memory by the nearest ones above that are, or
        by the topmost ones.

        The nodes between are read too, before the finer ones, so that a picture is refined step by
        step.

        Returns:
            The coarser cut, its parts, and what is to be read or kept for the given cut, coarse
            levels first. Together they exceed the limit of memory only by the replacements.
        """
        missing = {name: each for name, each in wanted.items() if each[0] not in cache}
        if not missing:
            self.missing = 0
            return cut, wanted, {}
        closed: dict[str, set[int]] = {path: set() for path in self._seen}
        between: Wanted = {}
        for path, (node, _) in missing:
            tree = self._seen[path].tree
            stand_in = None
            for stand_in in stand_ins(self._seen[path].spec.table, node, tree.lost):
                name = path, (stand_in, True)
                between[name] = self._request(name)
                if between[name][0] in cache:
                    break
            if stand_in is not None:
                closed[path].add(stand_in)
        coarser = closing(cut, [s.spec.table for s in self._seen.values()], list(closed.values()))
        drawn = self._wanted(coarser)
        self.missing = len(missing.keys() - drawn.keys())
        errors = dict(zip(self._seen, map(replaced_errors, cut.trees), strict=True))
        ahead, room = {}, self._settings.node_bytes
        room -= sum(request.size for _, request in (wanted | drawn).values())
        for name in sorted({**wanted, **between}, key=lambda n: -errors[n[0]].get(n[1][0], 0.0)):
            key, request = self._request(name)
            if name not in wanted:
                room -= request.size
            if name not in drawn and (name in wanted or room >= 0):
                ahead[name] = key, request
        return coarser, drawn, ahead

    def _give_up(self, failed: dict[Name, UsdSplatError]) -> bool:
        """Close the nodes above those that cannot be read. Return whether another cut is needed.

        A node with none above that could be drawn is left out.
        """
        changed = False
        for (path, (node, _)), error in failed.items():
            tree = self._seen[path].tree
            tree.problems[int(tree.spec.table.chunk[node])] = error
            stand_in = next(stand_ins(tree.spec.table, node), None)
            if stand_in is None or stand_in in tree.closed:
                tree.lost.add(node)
            else:
                tree.closed.add(stand_in)
            changed = True
        return changed

    def _field(self, path: str, part: Part, cloud: SplatCloud) -> Field:
        """Return a part of a node as a field of the draw list."""
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
                    lighting=spec.lighting,
                    captured_lights=spec.captured_lights,
                ),
                crops=tree.crops,
                spatial_order=StorageOrder(),
                first_element=int(tree.elements[int(is_inner), node]),
                tree=path,
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


def _parts(table: NodeTable, cut: Reached, most: float) -> tuple[Parts, Parts]:
    """Return the parts of a cut that are drawn: those of the capture, and proxies.

    A leaf has one part, its splats and residents. An inner node has its residents, and its proxies
    where it is not refined.

    Args:
        most: Error above which nodes are refined in all samples [pixel].
    """
    nodes = cut.nodes
    is_leaf, has_proxies = table.child_count[nodes] == 0, table.proxies[nodes] > 0
    captured = (table.residents[nodes] > 0) | (is_leaf & has_proxies)
    inner = ~is_leaf & has_proxies & (cut.errors <= most)
    return _by_node(cut, captured, is_inner=False), _by_node(cut, inner, is_inner=True)


def _by_node(cut: Reached, drawn: Bools, *, is_inner: bool) -> Parts:
    rows = np.flatnonzero(drawn)
    rows = rows[np.argsort(cut.nodes[rows], kind="stable")]
    nodes, counts = np.unique(cut.nodes[rows], return_counts=True)
    return Parts(
        is_inner=is_inner,
        nodes=nodes,
        counts=counts.astype(np.int64),
        instances=cut.instances[rows],
        errors=cut.errors[rows],
        above=cut.above[rows],
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
