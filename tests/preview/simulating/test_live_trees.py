"""Tests of a live simulation of a splat tree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Usd

from tests.cli.conftest import ball
from tests.cli.test_simulate_trees import ARRAYS, TREE, with_simulation
from tests.preview.simulating.hosts import running
from tests.trees import little_tree
from usdsplat import schema
from usdsplat.kernels.devices import open_device
from usdsplat.sim.stage.simulation import Simulation


def test_frames_of_a_cut_are_a_field_on_the_stage_until_a_reset(tmp_path: Path) -> None:
    """Oracle: the solver alone, and the mode of proxies; the tree is there again afterwards."""
    path = little_tree(tmp_path, ball(200))
    stage = Usd.Stage.Open(str(path))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    with_simulation(stage, **{"sim:treeLevel": 1})
    simulation = Simulation(stage, [1.0, 2.0], device=open_device(task="geometry"))
    simulation.begin()
    simulation.advance()
    expected = simulation.frame(TREE).cloud
    with running(stage) as (host, runner):
        for frame in (1.0, 2.0):
            runner.step()
            host.reached(frame)
        with host.lock:
            prim = stage.GetPrimAtPath(TREE)
            found = schema.fetch(prim, 2)
            assert schema.rasterize_mode(prim) == "antialiased"
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert schema.is_tree(stage.GetPrimAtPath(TREE))
