"""Tests of `usdsplat render --holdout` against the mathematics of compositing."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.cli.test_render import SMALL, read
from tests.images.test_deep import oiiotool

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


def deep(path, samples):
    """Write black samples, a function of the column: (A, Z, ZBack) of each, by OpenImageIO."""
    spec = oiio.ImageSpec(48, 32, 6, "float")
    spec.channelnames = ("R", "G", "B", "A", "Z", "ZBack")
    spec.deep = True
    data = oiio.DeepData()
    data.init(spec)
    for pixel in range(48 * 32):
        layers = samples(pixel % 48)
        data.set_samples(pixel, len(layers))
        for sample, values in enumerate(layers):
            for channel, value in zip((3, 4, 5), values, strict=True):
                data.set_deep_value(pixel, channel, sample, value)
    file = oiio.ImageOutput.create("openexr")
    assert file.open(str(path), spec), file.geterror()
    assert file.write_deep_image(data), file.geterror()
    file.close()


def smoke(column):
    """Two overlapping layers, and a wall behind them."""
    part = column / 47
    return [(0.9 * part, 3.2, 4.6), (0.6, 3.8 - part, 4.9), (0.3 + 0.7 * part, 4.2, 4.2)]


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_a_deep_holdout_is_a_deep_merge(run, shot, tmp_path, sorting):
    """Smoke that the splats are within. Oracle: `oiiotool --deepmerge` of our deep picture with
    the smoke, which is black, then `--flatten`; also of the deep picture that is held out."""
    words = ("render", shot, "--float", "--blend-space", "linear", "--sorting", sorting)
    words = (*words, "--frames", 1, *SMALL)
    whole, cg, merged, flat, held, ours = (tmp_path / f"{k}.exr" for k in range(6))
    deep(cg, smoke)
    # With ZBack, which --deepmerge needs in both.
    assert run(*words, "--deep", "--deep-error", 1e-9, "--no-compare", "-o", whole)[0] == 0
    assert run(*words, "--holdout", cg, "-o", held)[0] == 0
    assert run(*words, "--holdout", cg, "--deep", "--no-compare", "-o", ours)[0] == 0
    oiiotool(whole, cg, "--deepmerge", "-o", merged)
    oiiotool(merged, "--flatten", "-d", "float", "-o", flat)
    expected = read(flat)[..., :3].astype(np.float64)
    free = tmp_path / "free.exr"
    oiiotool(whole, "--flatten", "-d", "float", "-o", free)
    assert 0.2 < expected.max() < 0.8 * read(free)[..., :3].max()
    error = read(held)[..., :3] - expected
    assert 10 * np.log10(1 / np.mean(error**2)) > 60
    oiiotool(ours, "--flatten", "-d", "float", "-o", flat)
    assert np.abs(read(flat)[..., :4] - read(held)[..., :4]).max() < 1e-3


def test_a_flat_and_a_deep_holdout_of_a_wall_agree_by_ray_hits(run, shot, tmp_path):
    """An opaque wall through the ball. Oracle: each other; with zDepth, they differ, because the
    deep one hides a splat by its centre."""
    alpha, depth = np.ones((32, 48), np.float32), np.full((32, 48), 4, np.float32)
    cg(tmp_path / "flat.exr", alpha, depth)
    deep(tmp_path / "deep.exr", lambda column: [(1, 4, 4)])

    def apart(sorting):
        pictures = []
        for name in ("flat", "deep"):
            words = ("--aovs", "color", "--float", "--frames", 1, "--sorting", sorting, *SMALL)
            held = ("--holdout", tmp_path / f"{name}.exr")
            assert run("render", shot, "-o", tmp_path / "a.exr", *words, *held)[0] == 0
            pictures.append(read(tmp_path / "a.exr"))
        assert pictures[0][..., 3].max() > 0.5
        return np.abs(pictures[0] - pictures[1]).max()

    assert apart("rayHitDistance") < 1e-5
    assert apart("zDepth") > 1e-2


def test_pixels_without_a_depth_are_a_finding(run, shot, tmp_path):
    """Our own picture of many samples, whose A is averaged and whose Z is not. Oracle: the pixels
    counted in the file; the finding is made once, and --strict writes nothing."""
    words = ("render", shot, "--float", *SMALL)
    soft = ("--samples", 4, "--pixel-filter", "gaussian", "--aovs", "color,Z", "--frames", "1-2")
    assert run(*words, *soft, "-o", tmp_path / "cg.####.exr")[0] == 0
    pixels = read(tmp_path / "cg.0001.exr")
    count = int(((pixels[..., 3] > 0) & ~np.isfinite(pixels[..., 4])).sum())
    assert count > 0
    held = ("--frames", "1-2", "--holdout", tmp_path / "cg.####.exr", "--json")
    status, out, err = run(*words, *held, "-o", tmp_path / "held.####.exr")
    (found,) = [each for each in json.loads(out)["findings"] if each["code"] == "holdout-depth"]
    assert status == 0 and "these pixels hide nothing" in err
    assert found["found"] == f"{count:,} pixels with A above 0 and without a finite Z above 0"
    assert run(*words, *held, "--strict", "-o", tmp_path / "no.####.exr")[0] == 1
    assert not list(tmp_path.glob("no.*"))
