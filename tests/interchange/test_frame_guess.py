"""Tests of guessing the up direction from splats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core import axes, edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.interchange.frame_guess import guess_frame, up_of

FRAMES = {"rub": "+y", "rdf": "-y", "rfu": "+z"}


def cone(n=3000) -> SplatCloud:
    """Splats in a cone that stands with y up: three times as wide at its foot as at its head."""
    rng = np.random.default_rng(0)
    height = rng.uniform(0, 2, n)
    across = rng.normal(0, 1, (n, 2)) * (1.5 - height / 2)[:, None]
    places = np.column_stack([across[:, 0], height, across[:, 1]]).astype(np.float32)
    return replace(random_cloud(n, 0), positions=places)


def room(n=3000) -> SplatCloud:
    """Splats evenly in a box, half of them flat ones that lie on its floor; y is up."""
    rng = np.random.default_rng(0)
    places = rng.uniform(-1, 1, (n, 3))
    places[::2, 1] = rng.uniform(-1, -0.9, (n + 1) // 2)
    scales = np.full((n, 3), 0.01)
    scales[::2] = 0.03, 0.001, 0.03
    return replace(
        random_cloud(n, 0),
        positions=places.astype(np.float32),
        scales=scales.astype(np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
    )


def turned(cloud: SplatCloud, frame: str) -> SplatCloud:
    """The same in another frame."""
    matrix = np.eye(4)
    matrix[:3, :3] = axes.change("rub", frame)
    return edit.transform(cloud, matrix)


@pytest.mark.parametrize("make", [cone, room])
@pytest.mark.parametrize(("frame", "up"), FRAMES.items())
def test_up_is_found_whatever_the_frame(make, frame: str, up: str) -> None:
    """Oracle: how the cloud was made, and `core.axes` for the turn."""
    for assumed in FRAMES:
        guess = guess_frame(turned(make(), frame), assumed)
        assert (guess.up, guess.suggested) == (up, frame)
        assert guess.agrees == (assumed == frame)
        assert guess.evidence


def test_a_cloud_without_an_up_gets_no_guess() -> None:
    """Oracle: a ball looks alike from everywhere; a handful of splats says nothing."""
    for cloud in (random_cloud(3000, 0), random_cloud(20, 0), random_cloud(0, 0)):
        guess = guess_frame(cloud, "rdf")
        assert (guess.up, guess.suggested, guess.agrees) == (None, None, None)
        assert guess.evidence


def test_splats_that_are_not_finite_change_nothing() -> None:
    """Oracle: the guess without them."""
    bad = cone()
    bad.positions[::10] = np.nan
    bad.scales[1::10] = np.inf
    bad.rotations[2::10] = 0
    assert guess_frame(bad, "rub").up == "+y"
    bad.positions[:] = np.nan
    assert guess_frame(bad, "rub").up is None


def test_the_direction_up_of_a_frame() -> None:
    """Oracle: the letters themselves."""
    assert {frame: up_of(frame) for frame in FRAMES} == FRAMES
    assert up_of("urb") == "+x" and up_of("rfd") == "-z"
    with pytest.raises(UsageError):
        guess_frame(cone(), "rrr")


def test_captures_whose_frames_are_known_are_not_guessed_wrong(data) -> None:
    """Oracle: the data's README: y down, and one statue twice, half a turn about z apart."""
    expected = {
        "statue_angel.sog": "-y",
        "statue_angel.compressed.ply": "+y",
        "statue_massa.sog": "-y",
        "statue_trumpet.sog": "-y",
        "guitar.compressed.ply": "-y",
        "flowers_lod3_0.sog": "-y",
        "playbot_lod5.sog": "-y",
    }
    for name, up in expected.items():
        assert guess_frame(formats.read(data / "splats" / name).cloud, "rdf").up == up
    for path in (data / "splats" / "pod.spz", data / "seq_synthetic" / "monkey_0001.sog"):
        guess = guess_frame(formats.read(path).cloud, "rdf")
        assert guess.agrees is not False  # a head without a foot says nothing
