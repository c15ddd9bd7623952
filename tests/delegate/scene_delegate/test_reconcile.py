"""Tests of how a new traversal of the stage updates the index, with populations made by hand."""

from __future__ import annotations

import pytest

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.scene_delegate.population import Population, RprimEntry
from usdsplat.delegate.scene_delegate.reconcile import SEEN, reconcile
from usdsplat.render.scene import RenderScene


def population(*signature):
    return Population(fields={"/a": RprimEntry(source=None, appearances=(), signature=signature)})


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (population("source", "seen"), DirtyBits.CLEAN),
        (population("source", "seen otherwise"), SEEN),
        (population("elsewhere", "seen"), DirtyBits.ALL),
    ],
)
def test_a_field_is_dirty_by_what_is_different_about_it(after, expected):
    """Oracle: the arrays belong to the source; the rest is how it is seen."""
    index = RenderIndex(RenderParam(RenderScene()))
    before = population("source", "seen")
    reconcile(index, Population(), before)
    assert index.tracker.bits("/a") == index.fields["/a"].INITIAL_DIRTY_BITS
    index.tracker.clean("/a")
    reconcile(index, before, after)
    assert index.tracker.bits("/a") == expected


def test_prims_come_and_go():
    """Oracle: set difference, and a prim that changed its kind is another prim."""
    index = RenderIndex(RenderParam(RenderScene()))
    first = Population(instancers={"/x": None}, cameras={"/c": None})
    second = Population(instancers={"/c": None}, cameras={"/x": None, "/y": None})
    reconcile(index, Population(), first)
    reconcile(index, first, second)
    assert set(index.instancers) == {"/c"}
    assert set(index.cameras) == {"/x", "/y"}
    assert index.tracker.bits("/x") == index.cameras["/x"].INITIAL_DIRTY_BITS
