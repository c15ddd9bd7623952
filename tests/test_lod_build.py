"""Test of benchmarks.lod_build: that it measures the steps of the building as it is."""

from __future__ import annotations

from benchmarks import lod_build
from tests.interchange.lod.worlds import ground
from usdsplat import formats
from usdsplat.interchange.lod import nodes
from usdsplat.interchange.lod.options import MEMORY


def test_steps_are_measured(tmp_path):
    """Oracle: the sum: no step takes more than all, and the steps take most of it. The building is
    as before afterwards."""
    merge = nodes.level
    formats.write(ground(80_000), tmp_path / "world.ply")
    found = lod_build.measured(tmp_path / "world.ply", MEMORY)
    assert nodes.level is merge
    spent = dict(found["spent"])
    total = spent.pop("all")
    assert {"reading", "merging", "building levels"} <= set(spent) <= set(lod_build.STEPS)
    assert all(0 <= each <= total for each in spent.values())
    assert 0.5 * total < sum(spent.values()) <= 1.01 * total
