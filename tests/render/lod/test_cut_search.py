"""Tests of the search for a cut: it finds what measuring all nodes finds, with less work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.lod.exhaustive import all_reached, exhaustive
from tests.render.lod.trees import made
from tests.render.rendering import lens, random_transform, view_of
from usdsplat.core.node_table import NodeTable, check_nodes
from usdsplat.render.lod import cut as cuts
from usdsplat.render.lod.cut import TreeView, choose
from usdsplat.render.lod.measure import NodeMeasure
from usdsplat.render.lod.placing import Placing
from usdsplat.render.screen import Screen


def many(seed, model):
    """Two trees with many instances, some of equal errors, and two screens of a data window."""
    rng = np.random.default_rng(seed)
    views = []
    for number, count in ((seed, 8), (seed + 50, 3)):
        matrices = np.array([random_transform(100 * number + i) for i in range(count)])
        matrices[:, :3, 3] = rng.normal((0, 0, 6), 4, (count, 3))
        matrices[1] = matrices[0]
        both = np.stack([matrices, matrices])
        both[1, :, 0, 3] += 0.3
        both[1, 2] = np.nan
        table = made(number, n=300, leaf=12, strays=3).table
        table.proxies[:] = rng.integers(1, 90, len(table))  # fine levels may have fewer splats
        if number == seed:
            table.proxies[0], table.errors[0] = 0, np.inf
        mode = model == "tangential"
        views.append(
            TreeView(
                table=table,
                placings=tuple(map(Placing, both)),
                closed=frozenset({4}),
                tangential=mode,
            )
        )
    eye = lens("orthographic" if model == "orthographic" else "perspective")
    window = (-30, 20, 90, 140) if seed % 2 else None
    screen = Screen.of(view_of(eye, window))
    return views, [screen, replace(screen, center=(screen.center[0] + 0.4, screen.center[1]))]


@pytest.mark.parametrize("model", ["perspective", "orthographic", "tangential"])
@pytest.mark.parametrize("seed", range(2))
def test_the_cut_is_that_of_all_nodes(seed, model, monkeypatch):
    """Oracle: all nodes are measured one by one, and the last state that fits is taken."""
    views, screens = many(seed, model)
    trees = [all_reached(view, screens, 0.4) for view in views]
    for budget in (0, 1, 300, 600, 900, 1300, 1800, 2500, 4000, 8000):
        expected = exhaustive(views, trees, 0.4, budget)
        for step in (1, 32):
            monkeypatch.setattr(cuts, "STEP", step)
            found = choose(views, screens, error=0.4, budget=budget)
            is_same = (found.limit, found.splats, [_rows(each) for each in found.trees]) == expected
            assert is_same, budget  # pytest would take minutes to show where such lists differ


def _rows(reached):
    """Rows (node, instance, error, above, seen, shown)."""
    columns = (
        reached.nodes, reached.instances, reached.errors, reached.above, reached.seen,
        reached.shown,
    )  # fmt: skip
    return list(zip(*(each.tolist() for each in columns), strict=True))


def test_the_work_is_that_of_the_cut(monkeypatch):
    """Oracle: the count of measured nodes. Without a budget, more than 100 times as many nodes are
    drawn."""
    measured = []
    of = NodeMeasure.of

    def counted(self, instances, nodes):
        measured.append(len(nodes))
        return of(self, instances, nodes)

    monkeypatch.setattr(NodeMeasure, "of", counted)
    table = made(1, n=8000, leaf=8).table
    matrices = np.tile(np.eye(4), (60, 1, 1))
    matrices[:, 0, 3] = np.linspace(-30, 30, 60)
    matrices[:, 2, 3] = 40 + np.arange(60)
    views = [TreeView(table=table, placings=(Placing(matrices),))]
    screens = [Screen.of(view_of(lens()))]
    table.proxies[:], table.residents[:] = 10, 0  # a root with 4,000 proxies would fill any budget
    whole = choose(views, screens, error=1e-4)
    everything = sum(measured)
    measured.clear()
    part = choose(views, screens, error=1e-4, budget=3000)
    assert part.splats <= 3000 < whole.splats / 100
    assert sum(measured) < 4 * len(part.trees[0].nodes) + 200 < everything / 30
    assert len(measured) < 25


def test_nodes_of_a_box_inside_the_windows_are_shown():
    """Oracle: the measures of all nodes below those that are inside; both kinds occur."""
    tree = made(3, n=2000, leaf=8)
    matrices = np.array([random_transform(seed) for seed in range(40)])
    matrices[:, :3, 3] = np.random.default_rng(1).normal((0, 0, 4), 4, (40, 3))
    n, parents = len(tree.table), tree.table.parents()
    some = []
    for model in ("perspective", "orthographic"):
        measure = NodeMeasure(tree.table, Screen.of(view_of(lens(model))), Placing(matrices))
        found = measure.of(np.repeat(np.arange(40), n), np.tile(np.arange(n), 40))
        shown, inside = found.shown.reshape(40, n), found.inside.reshape(40, n)
        assert shown[:, 1:][inside[:, parents[1:]]].all()
        assert inside[:, 1:][inside[:, parents[1:]]].all()
        some += [inside.any(), (shown & ~inside).any()]
    assert all(some)


@pytest.mark.parametrize("wide, last", [(40.0, 100), (1.0, 10)], ids=["beside", "inside"])
def test_a_finer_cut_may_fit_where_a_coarser_one_does_not(wide, last):
    """Oracle: by hand. The root has 100 splats. Its children have 20; or 10 that can be seen, as
    the second one is beside the window."""
    low = np.float32([[0, 0, 0], [0, 0, 0], [0.8 * wide, 0, 0]])
    high = np.float32([[wide, 1, 1], [0.5, 1, 1], [wide, 1, 1]])
    table = NodeTable(
        low=low, high=high,
        errors=np.float32([1, 0, 0]),
        first_child=np.int32([1, 0, 0]),
        child_count=np.int32([2, 0, 0]),
        chunk=np.zeros(3, np.int32),
        first_row=np.int64([0, 100, 110]),
        proxies=np.int64([100, 10, last]),
        residents=np.zeros(3, np.int64),
    )  # fmt: skip
    check_nodes(table, "/tree", chunks=1)
    view = TreeView(table=table, placings=(Placing(np.eye(4)[None]),))
    cut = choose([view], [Screen.of(view_of(lens()))], error=1.0, budget=50)
    assert cut.splats == (10 if wide > 1 else 20)
    drawn = cut.trees[0].above_error(cut.limit)
    assert drawn.nodes[~drawn.refined].tolist() == [1, 2]
