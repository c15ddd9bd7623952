"""Tests of `usdsplat render --holdout` against the mathematics of compositing."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.cli.test_render import SMALL, read

pytestmark = pytest.mark.usefixtures("compiled")


def cg(path, alpha, depth):
    """Write a picture of another renderer: black, with A and Z, by OpenImageIO."""
    spec = oiio.ImageSpec(48, 32, 5, "float")
    spec.channelnames = ("R", "G", "B", "A", "Z")
    black = np.zeros((32, 48, 3), np.float32)
    file = oiio.ImageOutput.create("openexr")
    assert file.open(str(path), spec)
    assert file.write_image(np.dstack([black, alpha, depth]))
    file.close()


@pytest.mark.parametrize("space", ["auto", "linear"])
def test_an_antialiased_edge_lets_through_what_it_does_not_cover(run, shot, tmp_path, space):
    """Oracle: 1 - A times the picture without it, as OpenEXR composites a sample in front of all
    others; the ball is behind the edge in the left half and before it in the right."""
    words = ("render", shot, "--aovs", "color", "--float", "--blend-space", space, *SMALL)
    assert run(*words, "-o", tmp_path / "whole.exr", "--frames", 1)[0] == 0
    alpha = np.tile(np.linspace(0, 1, 48, dtype=np.float32) ** 2, (32, 1))
    depth = np.where(np.arange(48) < 24, np.float32(2), np.float32(9)) * np.ones((32, 1))
    cg(tmp_path / "cg.exr", alpha, depth.astype(np.float32))
    held = ("-o", tmp_path / "held.exr", "--holdout", tmp_path / "cg.exr")
    assert run(*words, *held, "--frames", 1)[0] == 0
    passed = np.where(depth < 4, 1 - alpha, 1)[..., None]
    whole = read(tmp_path / "whole.exr").astype(np.float64)
    error = read(tmp_path / "held.exr") - passed * whole
    assert whole[..., 3].max() > 0.9
    assert 10 * np.log10(1 / np.mean(error**2)) > 60


def test_opaque_pixels_are_the_same_beside_edges(run, shot, tmp_path):
    """Oracle: the picture with a holdout that is opaque everywhere; a soft pixel elsewhere changes
    only the order of sums."""
    alpha, depth = np.ones((32, 48), np.float32), np.full((32, 48), 4, np.float32)
    cg(tmp_path / "hard.exr", alpha, depth)
    alpha[31, 47] = 0.5
    cg(tmp_path / "soft.exr", alpha, depth)
    pictures = []
    for name in ("hard", "soft"):
        words = ("--aovs", "color,Z,id", "--float", "--frames", 1, *SMALL)
        held = ("--holdout", tmp_path / f"{name}.exr")
        assert run("render", shot, "-o", tmp_path / "a.exr", *words, *held)[0] == 0
        pictures.append(read(tmp_path / "a.exr"))
    np.testing.assert_allclose(pictures[0][:31], pictures[1][:31], rtol=1e-5, atol=1e-6)
