"""Tests of cuts in which coarser nodes stand for those that are not in memory."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import fields

import numpy as np
import pytest

from tests.render.lod.drawn import drawn_nodes
from tests.render.lod.test_nodes import tree_scene
from tests.render.lod.trees import made
from tests.render.rendering import lens, view_of
from usdsplat.render.lod import nodes as nodes_module
from usdsplat.render.lod.cut import TreeView, choose
from usdsplat.render.lod.placing import Placing
from usdsplat.render.lod.stand_ins import closing, replaced_errors, stand_ins
from usdsplat.render.screen import Screen


def cut_of(tree, screen, closed=()):
    transforms = np.tile(np.eye(4), (1, 2, 1, 1))
    transforms[0, 1, 3, 0] = 1.0
    view = TreeView(
        table=tree.table, placings=tuple(map(Placing, transforms)), closed=frozenset(closed)
    )
    return choose([view], [screen], error=0.5)


@pytest.mark.parametrize("seed", range(5))
def test_closing_nodes_of_a_cut_is_choosing_with_these_nodes_closed(seed):
    """Oracle: the search for a cut that never refines them, array by array."""
    tree, screen = made(seed, n=600, error=0.05), Screen.of(view_of(lens()))
    inner = np.flatnonzero(tree.table.child_count)
    closed = set(np.random.default_rng(seed).choice(inner[1:], 3, replace=False).tolist())
    (expected,) = cut_of(tree, screen, closed).trees
    whole = cut_of(tree, screen)
    (found,) = closing(whole, [tree.table], [closed]).trees
    for each in fields(found):
        np.testing.assert_array_equal(getattr(found, each.name), getattr(expected, each.name))
    assert 0 < len(found.nodes) < len(whole.trees[0].nodes)


def test_nodes_above_are_found_by_their_parents():
    """Oracle: a walk over the children; one without proxies and a lost one are left out."""
    tree = made(1)
    table, node = tree.table, int(np.flatnonzero(tree.table.child_count == 0)[-1])
    expected, at = [], node
    while at:
        (at,) = (
            i
            for i, (first, count) in enumerate(
                zip(table.first_child.tolist(), table.child_count.tolist(), strict=True)
            )
            if first <= at < first + count
        )
        expected.append(at)
    assert list(stand_ins(table, node)) == expected and len(expected) > 2
    assert list(stand_ins(table, node, {expected[1]})) == [expected[0], *expected[2:]]
    table.proxies[expected[0]] = 0
    assert list(stand_ins(table, node)) == expected[1:]


def test_errors_that_nodes_replace_are_the_largest_of_all_instances():
    """Oracle: a loop over the rows of the cut."""
    (reached,) = cut_of(made(2), Screen.of(view_of(lens()))).trees
    expected = {}
    for node, above in zip(reached.nodes.tolist(), reached.above.tolist(), strict=True):
        expected[node] = max(above, expected.get(node, 0.0))
    assert replaced_errors(reached) == expected


@pytest.mark.parametrize("seed", range(5))
def test_every_leaf_is_under_one_drawn_node_whatever_is_in_memory(seed, monkeypatch):
    """Oracle: the leaves below the drawn nodes, by a walk; each is there once. Only drawn nodes are
    in memory besides those that were, and the cut is searched once."""
    tree = made(seed, n=600)
    table, view = tree.table, view_of(lens())
    there = set(np.random.default_rng(seed).choice(len(table), len(table) // 3).tolist()) | {0}
    scene = tree_scene(tree, load=lambda *rows: tree.load(*rows))
    searches = []

    def counted(*args, **options):
        searches.append(1)
        return choose(*args, **options)

    monkeypatch.setattr(nodes_module, "choose", counted)
    monkeypatch.setattr(type(scene.node_cache), "__contains__", lambda _, key: key[0][1] in there)
    drawn = drawn_nodes(scene, view, lod_error=0.0, lod_samples=1, node_wait=False)
    assert len(searches) == 1 and drawn <= there

    def leaves(node):
        first, count = int(table.first_child[node]), int(table.child_count[node])
        if not count:
            return [node]
        return [leaf for child in range(first, first + count) for leaf in leaves(child)]

    found = sorted(leaf for node in drawn for leaf in leaves(node))
    whole = drawn_nodes(scene, view, lod_error=0.0, lod_samples=1)
    assert len(set(found)) == len(found) and set(found) >= whole


def test_nodes_that_wait_for_their_siblings_are_not_read_twice():
    """Oracle: the reads, counted. One leaf cannot be read, so its siblings are not drawn either;
    nothing is kept that nobody asks for."""
    tree, view = made(3, n=600), view_of(lens())
    last, go = len(tree.table) - 1, threading.Event()

    def load(chunk, first, count):
        if chunk == last:
            assert go.wait(20)
        return tree.load(chunk, first, count)

    scene = tree_scene(tree, load=load)
    settings = {"lod_error": 0.0, "lod_samples": 1, "node_wait": False, "node_lifetime": 0.0}
    drawn_nodes(scene, view, **settings)
    while len(scene.node_cache._reading) > 1:
        time.sleep(0.01)
    sibling = last - 1
    for _ in range(3):
        drawn = drawn_nodes(scene, view, **settings)
        assert not {last, sibling} & drawn
    assert [each[0] for each in tree.reads].count(sibling) == 1
    go.set()
    drawn = drawn_nodes(scene, view, **{**settings, "node_wait": True})
    assert {last, sibling} <= drawn
    assert max(Counter(each[0] for each in tree.reads).values()) == 1
    scene.close()
