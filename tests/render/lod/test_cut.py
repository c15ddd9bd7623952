"""Tests of the choice of cuts: completeness, order of refinement, budgets and fading."""

from __future__ import annotations

import heapq

import numpy as np
import pytest

from tests.render.lod.trees import made
from tests.render.lod.visible import visible_nodes
from tests.render.rendering import lens, view_of
from usdsplat.render.lod.cut import FADE, TreeView, choose
from usdsplat.render.lod.measure import NodeMeasure
from usdsplat.render.lod.placing import Placing
from usdsplat.render.screen import Screen


def placed(*offsets, scale=1.0):
    """Instances beside each other, as one sample sees them."""
    matrices = np.tile(np.diag([scale, scale, scale, 1.0]), (len(offsets), 1, 1))
    matrices[:, :3, 3] = offsets
    return (Placing(matrices),)


def screen_of(model="perspective"):
    return Screen.of(view_of(lens(model)))


def covers(table, nodes):
    """How often each leaf is at or below one of the nodes."""
    parents, chosen = table.parents(), set(nodes.tolist())
    leaves = np.flatnonzero(table.child_count == 0)
    found = []
    for leaf in leaves:
        count, at = 0, int(leaf)
        while at >= 0:
            count += at in chosen
            at = int(parents[at])
        found.append(count)
    return found


def by_heap(views, screens, error, budget):
    """The cut by its definition: refine the largest error while it is above the limit, and take the
    last state whose visible splats fit, or the first one. Equal errors do not occur."""
    sizes, heap, total, cut = {}, [], 0, set()

    def measure(t, i, node, above):
        found = [
            NodeMeasure(views[t].table, s, m).of(np.array([i]), np.array([node]))
            for s, m in zip(screens, views[t].placings, strict=True)
        ]
        errors = [float(each.errors[0]) for each in found]
        return min(above, max(errors)), any(bool(each.shown[0]) for each in found)

    def push(t, i, node, above):
        nonlocal total
        table = views[t].table
        worst, shown = measure(t, i, node, above)
        sizes[t, i, node] = int(table.proxies[node] + table.residents[node]) if shown else 0
        total += sizes[t, i, node]
        cut.add((t, i, node))
        if table.child_count[node] and worst > error:
            heapq.heappush(heap, (-worst, t, i, node))

    for t, view in enumerate(views):
        for i in range(len(view.placings[0].transforms)):
            push(t, i, 0, np.inf)
    best = set(cut)
    while heap:
        worst, t, i, node = heapq.heappop(heap)
        table = views[t].table
        total -= int(table.proxies[node]) if sizes[t, i, node] else 0
        cut.discard((t, i, node))
        first = int(table.first_child[node])
        for child in range(first, first + int(table.child_count[node])):
            push(t, i, child, -worst)
        if budget == 0 or total <= budget:
            best = set(cut)
    return best


@pytest.mark.parametrize("model", ["perspective", "orthographic"])
@pytest.mark.parametrize("budget", [0, 900, 1500, 10])
@pytest.mark.parametrize("seed", range(3))
def test_the_cut_is_that_of_a_heap(seed, budget, model):
    """Oracle: refinement one by one with a heap, of two trees with several instances."""
    views = [
        TreeView(table=made(seed).table, placings=placed((0, 0, 0), (1.1, 0.3, -2.0), (9, 9, 0))),
        TreeView(table=made(seed + 7).table, placings=placed((-1.2, 0.1, 1.3), scale=1.7)),
    ]
    error = 1.5 if model == "perspective" else 0.6
    cut = choose(views, [screen_of(model)], error=error, budget=budget)
    found = set()
    for t, reached in enumerate(cut.trees):
        drawn = reached.above_error(cut.limit)
        rows = zip(drawn.instances.tolist(), drawn.nodes.tolist(), drawn.refined, strict=True)
        found |= {(t, i, node) for i, node, refined in rows if not refined}
    assert found == by_heap(views, [screen_of(model)], error, budget)


@pytest.mark.parametrize("fade", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("budget", [0, 500, 700])
def test_every_leaf_is_covered_exactly_once(budget, fade):
    """Oracle: the definition of a cut, counted leaf by leaf."""
    tree = made(3, leaf=10)
    view = TreeView(table=tree.table, placings=placed((0, 0, 0), (0.5, 0, 3.0)))
    cut = choose([view], [screen_of()], error=1.0, budget=budget)
    drawn = cut.trees[0].above_error(cut.error_at(fade))
    for instance in (0, 1):
        nodes = drawn.nodes[(drawn.instances == instance) & ~drawn.refined]
        assert covers(tree.table, nodes) == [1] * int((tree.table.child_count == 0).sum())


def test_a_larger_budget_only_refines():
    """Oracle: sets of refined nodes, which must grow with the budget; and the counts."""
    view = TreeView(table=made(5, leaf=8).table, placings=placed((0, 0, 0), (0.7, 0.2, -5.0)))
    before, counts = set(), []
    for budget in (1, 300, 340, 380, 420, 440, 0):
        cut = choose([view], [screen_of()], error=0.2, budget=budget)
        reached = cut.trees[0]
        refined = reached.errors > cut.limit
        now = set(zip(reached.instances[refined], reached.nodes[refined], strict=True))
        assert now >= before
        before = now
        counts.append(cut.splats)
        sizes = (view.table.proxies + view.table.residents)[reached.nodes]
        seen = np.where(refined, view.table.residents[reached.nodes], sizes)[reached.shown].sum()
        assert seen == cut.splats
        assert budget < 300 or cut.splats <= budget or budget == 0
    assert len(set(counts)) > 3


def test_the_error_of_a_far_node_is_that_of_similar_triangles():
    """Oracle: error [unit] times focal length over the depth of the box's near side, for a box on
    the axis; and no distance for parallel rays. A scaled instance has a scaled error."""
    table = made(2, leaf=1000).table  # one node
    table = type(table)(**{k: getattr(table, k) for k in table.__dataclass_fields__})
    table.errors[:] = 0.01
    table.low[:], table.high[:] = -1, 1
    matrices = np.diag([3.0, 3.0, 3.0, 1.0])[None]
    matrices[0, :3, 3] = 0, 0, 46  # the camera is at z = -4
    screen = screen_of()
    found = NodeMeasure(table, screen, Placing(matrices)).of(np.zeros(1, int), np.zeros(1, int))
    assert found.shown[0]
    np.testing.assert_allclose(found.errors[0], 0.03 * max(screen.focal) / (50 - 3), rtol=1e-6)
    screen = screen_of("orthographic")
    found = NodeMeasure(table, screen, Placing(matrices)).of(np.zeros(1, int), np.zeros(1, int))
    np.testing.assert_allclose(found.errors[0], 0.03 * 22.0, rtol=1e-6)


def test_the_largest_singular_value_scales_the_error():
    """Oracle: a stretched instance against a uniformly scaled one of the same largest scale, seen
    from afar."""
    table = made(2, leaf=100).table
    found = []
    for scale in ((5.0, 1.0, 1.0), (5.0, 5.0, 5.0)):
        matrices = np.diag([*scale, 1.0])[None]
        matrices[0, 2, 3] = 1e6
        measure = NodeMeasure(table, screen_of(), Placing(matrices))
        measured = measure.of(np.zeros(1, int), np.zeros(1, int))
        found.append(measured.errors[0])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4)


def test_nodes_of_all_samples_decide():
    """Oracle: the cut of two samples refines what either of them refines alone."""
    tree = made(4, leaf=10)
    near, far = placed((0, 0, -2.5)), placed((0, 0, 40.0))
    screen = screen_of()

    def refined(placings):
        view = TreeView(table=tree.table, placings=placings)
        cut = choose([view], [screen] * len(placings), error=1.0)
        reached = cut.trees[0]
        return set(reached.nodes[reached.errors > 1.0].tolist())

    both = refined((*near, *far))
    assert both == refined(near) | refined(far)
    assert both != refined(far)


def test_fading_reaches_from_the_limit_to_its_end():
    """Oracle: the definition. At 0 the children of a node are drawn whose error is above the limit,
    at 1 only those of a node above FADE times the limit."""
    tree = made(6, leaf=10, error=0.02)
    view = TreeView(table=tree.table, placings=placed((0, 0, 1.0)))
    cut = choose([view], [screen_of()], error=0.8)
    reached = cut.trees[0]
    for fade, error in ((0.0, 0.8), (1.0, 0.8 * FADE)):
        drawn = reached.above_error(cut.error_at(fade))
        expected = set(reached.nodes[reached.errors > error].tolist())
        assert set(drawn.nodes[drawn.refined].tolist()) == expected


def test_a_node_that_is_closed_is_drawn_itself():
    """Oracle: the definition; nothing below it is reached."""
    tree = made(6, leaf=10)
    view = TreeView(table=tree.table, placings=placed((0, 0, 0)), closed=frozenset({1}))
    reached = choose([view], [screen_of()], error=0.0).trees[0]
    below = set(range(int(tree.table.first_child[1]), int(tree.table.first_child[1]) + 2))
    assert 1 in reached.nodes and not below & set(reached.nodes.tolist())


def test_a_node_without_proxies_is_refined_under_any_budget():
    """Oracle: an infinite error; the children of the root are drawn although they exceed 1."""
    tree = made(6, leaf=10)
    tree.table.errors[0], tree.table.proxies[0] = np.inf, 0
    view = TreeView(table=tree.table, placings=placed((0, 0, 0)))
    cut = choose([view], [screen_of()], error=1.0, budget=1)
    drawn = cut.trees[0].above_error(cut.limit)
    assert drawn.nodes[~drawn.refined].tolist() == [1, 2]


def test_a_transform_that_is_not_finite_shows_nothing():
    """Oracle: such an instance is never drawn."""
    tree = made(6)
    view = TreeView(table=tree.table, placings=(Placing(np.full((1, 4, 4), np.nan)),))
    cut = choose([view], [screen_of()], error=1.0)
    assert cut.splats == 0 and not cut.trees[0].seen.any()


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("model", ["perspective", "orthographic", "tangential"])
def test_no_node_with_a_visible_splat_is_left_out(seed, model):
    """Oracle: the projection kernel, by which each splat is visible or not, for random transforms
    and data windows."""
    expected, found = visible_nodes(seed, model)
    assert expected <= found
