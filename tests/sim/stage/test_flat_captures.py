"""Tests of the preset shatter on captures that are thin, or have few splats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.sim.recipes import ball, played
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.devices import open_device
from usdsplat.sim.stage.presets import author_preset
from usdsplat.sim.stage.recipe import StageRecipe, find_simulations, recipes

COUNT = 600


def shattered(
    folder: Path, cloud: SplatCloud, spacing: float | None
) -> tuple[Usd.Stage, StageRecipe]:
    """The preset on a capture, with its own distance of carriers or another one."""
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    schema.author(stage, "/World/Scan", cloud)
    stage.Save()
    author_preset("shatter", stage, folder / "sim.usda")
    made = Usd.Stage.Open(str(folder / "sim.usda"))
    (sim,) = find_simulations(made)
    if spacing is not None:
        sim.GetAttribute("splatSim:carriers:spacing").Set(spacing)
    (recipe,) = recipes(made, sim)
    return made, recipe


@pytest.mark.parametrize("spacing", [None, 0.04])
@pytest.mark.parametrize("thin", [(1, 0, 1), (1, 0, 0), (0, 1, 0)], ids=["sheet", "line", "pole"])
def test_what_is_thin_stays_within_reach(thin, spacing, tmp_path) -> None:
    """Oracle: lengths: all positions are finite, and in 6 frames nothing goes further than the
    capture and the ball are large."""
    cloud = ball(COUNT)
    cloud = replace(cloud, positions=cloud.positions * np.float32(thin))
    _stage, recipe = shattered(tmp_path, cloud, spacing)
    for frame in played(open_device(threads=1), recipe, 6):
        assert np.isfinite(frame.cloud.positions).all()
        assert np.abs(frame.cloud.positions).max() < 6


def test_the_filling_is_as_fine_as_the_capture(tmp_path) -> None:
    """Oracle: distances of splats: carriers of few splats are at least half as far apart; those of
    more are 72 along the capture."""
    for number, count in enumerate((COUNT, 20 * COUNT)):
        folder = tmp_path / str(number)
        folder.mkdir()
        _stage, recipe = shattered(folder, ball(count), None)
        found = recipe.at(1.0).parameters.carriers.spacing
        apart = np.sqrt(4 * np.pi / count)
        size = float(np.ptp(np.percentile(ball(count).positions, (5, 95), axis=0), axis=0).max())
        if count == COUNT:
            assert 0.3 * apart < found < apart and found > 1.5 * size / 72
        else:
            assert found == pytest.approx(size / 72, rel=1e-5)
