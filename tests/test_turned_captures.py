"""Tests of rotated captures, compared with the results of other tools and with pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.interchange.samples import read_ply
from tests.renders import psnr
from tests.test_oracle_pictures import add_camera
from usdsplat.cli.main import main
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.opening import open_capture
from usdsplat.render.settings import RenderSettings


@pytest.mark.parametrize("turn", [(0, 0, 90), (90, 0, 0), (10, 20, 30)])
@pytest.mark.parametrize("way", ["to a capture", "by way of a stage"])
def test_a_turn_is_the_one_that_another_program_makes(data: Path, tmp_path, turn, way) -> None:
    """Oracle: splat-transform's files, turned by T Rz Ry Rx T with T = diag(-1, -1, 1), which is
    Rz(c) Ry(-b) Rx(-a); harmonics to 1e-5.
    """
    a, b, c = turn
    flags = ["--rotate", f"{-a},{-b},{c}"]
    source, target = data / "oracle" / "tiny.ply", tmp_path / "turned.ply"
    if way == "to a capture":
        assert main(["convert", str(source), str(target), *flags]) == 0
    else:
        stage = tmp_path / "turned.usdc"
        assert main(["convert", str(source), str(stage), *flags]) == 0
        assert main(["convert", str(stage), str(target)]) == 0
    expected = read_ply(data / "oracle" / f"rot_{a}_{b}_{c}.ply")
    found = read_ply(target)
    np.testing.assert_allclose(found["sh"], expected["sh"], atol=1e-5)
    np.testing.assert_allclose(found["positions"], expected["positions"], atol=1e-5)
    np.testing.assert_allclose(found["scales"], expected["scales"], rtol=1e-5)
    same = np.abs((found["rotations"] * expected["rotations"]).sum(axis=1))  # q and -q are one
    np.testing.assert_allclose(same, 1, atol=1e-6)


def picture(path: Path, oracle: np.lib.npyio.NpzFile, number: int) -> np.ndarray:
    """The capture through a camera of the oracle's, over black, shape (height, width, 3)."""
    stage = open_capture(path)
    size = int(oracle["width"]), int(oracle["height"])
    add_camera(stage, "/World/view", oracle["viewmats"][number], oracle["K"], size)
    with Engine(stage) as engine:
        view = engine.view(camera="/World/view", resolution=size)
        settings = RenderSettings(color_mode="display")
        return np.asarray(engine.picture(view, settings, ("color",))["color"][..., :3])


@pytest.mark.parametrize("number", [0, 1])
def test_one_capture_in_two_files_looks_alike_after_the_turn(data, tmp_path, number: int) -> None:
    """Oracle: statue_angel.sog, whose twin in compressed PLY stands 180 degrees about z from it; 30
    dB between the two, and far less before the turn.
    """
    twin = data / "splats" / "statue_angel.compressed.ply"
    turned = tmp_path / "turned.ply"
    assert main(["convert", str(twin), str(turned), "--rotate", "0,0,180"]) == 0
    with np.load(data / "oracle" / "images" / "statue_angel.npz") as oracle:
        expected = picture(data / "splats" / "statue_angel.sog", oracle, number)
        decibels = [psnr(picture(path, oracle, number), expected) for path in (turned, twin)]
    assert decibels[0] >= 30, decibels
    assert decibels[1] < 20, decibels
    print(f"view {number}: {decibels[0]:.1f} dB turned, {decibels[1]:.1f} dB as it is")
