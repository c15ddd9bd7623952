"""Tests of the change tracker. Oracle of all: Hydra's rules, stated by hand."""

from __future__ import annotations

from usdsplat.delegate.change_tracker import ChangeTracker
from usdsplat.delegate.dirty_bits import DirtyBits


def test_bits_add_up_until_they_are_cleaned():
    """Oracle: set union."""
    tracker = ChangeTracker()
    tracker.insert("/a", DirtyBits.CLEAN)
    tracker.mark("/a", DirtyBits.TRANSFORM)
    tracker.mark("/a", DirtyBits.PRIMVAR)
    assert tracker.bits("/a") == DirtyBits.TRANSFORM | DirtyBits.PRIMVAR
    tracker.clean("/a", DirtyBits.PRIMVAR)
    assert tracker.bits("/a") == DirtyBits.PRIMVAR
    tracker.clean("/a")
    assert tracker.bits("/a") == DirtyBits.CLEAN


def test_prims_that_are_not_tracked_are_never_dirty():
    """Oracle: nothing in, nothing out."""
    tracker = ChangeTracker()
    tracker.mark("/a", DirtyBits.ALL)
    assert tracker.bits("/a") == DirtyBits.CLEAN
    tracker.insert("/a", DirtyBits.ALL)
    tracker.remove("/a")
    tracker.mark_all(DirtyBits.ALL)
    assert tracker.bits("/a") == DirtyBits.CLEAN


def test_an_instancer_dirties_what_it_carries_and_only_by_its_arrays():
    """Oracle: Hydra's instancer-to-rprim dependency."""
    tracker = ChangeTracker()
    for path in ("/instancer", "/carried", "/other"):
        tracker.insert(path, DirtyBits.CLEAN)
    tracker.carry("/instancer", ["/carried"])
    tracker.mark("/instancer", DirtyBits.TRANSFORM)
    assert tracker.bits("/carried") == DirtyBits.CLEAN
    tracker.mark("/instancer", DirtyBits.INSTANCER)
    assert tracker.bits("/carried") == DirtyBits.INSTANCER
    assert tracker.bits("/other") == DirtyBits.CLEAN
