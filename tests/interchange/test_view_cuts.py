"""Tests of the cuts of views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.lod.trees import Made, made
from usdsplat.core.node_cuts import NodeCut, level_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.interchange.tree_reading import ViewChoice
from usdsplat.interchange.view_cuts import view_cuts
from usdsplat.render.specs import CameraSpec, Framing, View
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.tree import Tree

TREE = made(1, leaf=30)


def tree_of(made_tree: Made, table: NodeTable | None = None) -> Tree:
    return Tree(
        table=table or made_tree.table,
        chunks=(),
        chunk_names=(),
        degree=0,
        color_space="",
        drawing=DrawingHints(projection_mode="perspective"),
        pixel=0.0,
    )


def placed(*offsets: tuple[float, float, float]) -> np.ndarray:
    """Matrices of instances that are only moved."""
    found = np.tile(np.eye(4), (len(offsets), 1, 1))
    found[:, :3, 3] = offsets
    return found


def along_z(error: float, budget: int = 0) -> ViewChoice:
    """The view of a camera at the origin that looks down -z, and its limits."""
    camera = CameraSpec(path="", world_to_camera=tuple(np.eye(4).ravel().tolist()))
    view = View(camera=camera, framing=Framing(resolution=(400, 300)))
    return ViewChoice(view=view, error=error, budget=budget)


def stops(table: NodeTable, cut: NodeCut) -> list[int]:
    """Number of nodes of the cut at or above each leaf."""
    parents, chosen, found = table.parents(), set(cut.nodes.tolist()), []
    for leaf in np.flatnonzero(table.child_count == 0).tolist():
        way = [leaf]
        while (above := int(parents[way[-1]])) >= 0:
            way.append(above)
        found.append(len(chosen.intersection(way)))
    return found


def test_what_is_near_is_fine_and_what_is_behind_is_the_root() -> None:
    """Oracle: closed form: the error 0 asks for leaves wherever the view looks; behind it is the
    root; far away, a pixel is larger than all errors."""
    places = placed((0, 0, -5), (0, 0, 50), (0, 0, -900), (0.1, 0, -5))
    (fine,) = view_cuts([(tree_of(TREE), places)], along_z(0.0), beside=0)
    np.testing.assert_array_equal(fine[0].nodes, level_cut(TREE.table, 0).nodes)
    assert fine[1].nodes.tolist() == [0] and fine[3] is fine[0]
    (coarse,) = view_cuts([(tree_of(TREE), places)], along_z(5.0), beside=0)
    assert coarse[2].nodes.tolist() == [0]
    assert 0 < len(coarse[0].nodes) < len(fine[0].nodes)


@pytest.mark.parametrize("error", [0.0, 0.5, 2.0, 8.0])
def test_every_leaf_is_below_one_node_of_the_cut(error: float) -> None:
    """Oracle: what makes a cut complete, counted from the leaves up."""
    places = placed((0, 0, -1), (2, 0, -3), (0, 1, -9), (0, 0, 4))
    (cuts,) = view_cuts([(tree_of(TREE), places)], along_z(error), beside=0)
    for cut in cuts:
        assert set(stops(TREE.table, cut)) == {1}


def test_nodes_without_proxies_are_refined_out_of_view_too() -> None:
    """Oracle: a root without proxies behind the camera, whose two children stand for it."""
    errors, proxies = TREE.table.errors.copy(), TREE.table.proxies.copy()
    errors[0], proxies[0] = np.inf, 0
    table = replace(TREE.table, errors=errors, proxies=proxies)
    (cuts,) = view_cuts([(tree_of(TREE, table), placed((0, 0, 50)))], along_z(1.0), beside=0)
    assert cuts[0].nodes.tolist() == [1, 2] and cuts[0].above.tolist() == [0]


def test_fields_take_their_part_of_the_budget() -> None:
    """Oracle: a budget of as many splats more gives the same cut; a smaller one a coarser cut."""
    tree, places = tree_of(TREE), placed((0, 0, -5))
    sizes = [
        view_cuts([(tree, places)], along_z(0.0, budget), beside=beside)[0][0].splats(TREE.table)
        for budget, beside in ((0, 10**6), (300, 0), (1300, 1000), (200, 0), (1, 10**6))
    ]
    assert sizes[1] == sizes[2] <= 300 < sizes[0] == 400
    assert sizes[3] <= 200 and sizes[4] == 200  # the root
