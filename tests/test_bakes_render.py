"""Tests that pictures show the simulated values, at frames, between them, and with any shutter."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.renders import CAMERA, SIZE, between, blurred, psnr, seen, source, still, stills
from tests.sim.stage.bakes import PATH
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine

LIVES = ("dense", "clips", "packed")
ALL_MODES = (*LIVES, "edit")
NEARLY = {"dense": 80, "clips": 80, "packed": 65, "edit": 80}
"""[dB] of pictures of a bake; those of mode packed by what packing costs, of edit by epsilon."""
SHUTTERS = {
    "open before": (4, (-0.5, 0.0)),
    "across a birth": (4, (-0.25, 0.25)),
    "into the next epoch": (4, (0.3, 0.9)),
    "across a death": (5, (0.0, 1.0)),
    "across an epoch's end": (9, (-0.25, 0.25)),
    "across births at an epoch's end": (13, (-0.5, 0.5)),
    "past the end": (14, (0.0, 0.5)),
    "before the beginning": (1, (-0.5, 0.5)),
}
"""Of a bake over frames 1 to 14 with epochs of 4: frame, and shutter in frames."""


def muted(target: Path) -> Usd.Stage:
    """The stage of a bake, its results muted."""
    stage = Usd.Stage.Open(str(target))
    root = stage.GetRootLayer()
    stage.MuteLayer(Sdf.ComputeAssetPathRelativeToLayer(root, root.subLayerPaths[0]))
    return stage


@pytest.mark.parametrize("mode", ALL_MODES)
def test_any_shutter_sees_the_frames_and_what_is_between(tmp_path: Path, mode: str) -> None:
    """Oracle: the mean of still pictures of the solver's own frames, mixed by identity in float64;
    past the last frame velocities lead on, but those of mode edit, which has none; before the
    first one all is held."""
    bake = seen(tmp_path, mode)
    frames = bake.frames[PATH]
    with Engine(Usd.Stage.Open(str(bake.target))) as engine:
        for name, (frame, shutter) in SHUTTERS.items():
            found, times = blurred(engine, frame, shutter, 4)
            if mode == "edit":
                times = np.clip(times, 1, 14)
            mean = stills([between(frames, time) for time in times], source(bake), PATH)
            assert psnr(found, mean) > NEARLY[mode], name


@pytest.mark.parametrize("mode", LIVES)
def test_nobody_is_seen_before_birth_or_after_death(tmp_path: Path, mode: str) -> None:
    """Oracle: still pictures of the solver's own frames, where those that are not there are not;
    bit for bit where the bake holds every bit."""
    bake = seen(tmp_path, mode)
    with Engine(Usd.Stage.Open(str(bake.target))) as engine:
        for frame in bake.frames[PATH]:
            found = still(engine, frame.time)
            expected = stills([frame.cloud], source(bake), PATH)
            if mode == "packed":
                assert psnr(found, expected) > NEARLY[mode]
            else:
                np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("mode", ALL_MODES)
def test_nothing_jumps_where_epochs_meet(tmp_path: Path, mode: str) -> None:
    """Oracle: pictures change no more across the boundary than as long before and after it, but
    for what packing costs; splats are born at the last one."""
    bake = seen(tmp_path, mode)
    step = 2.0**-6
    with Engine(Usd.Stage.Open(str(bake.target))) as engine:
        for start in (5, 9, 13):
            pictures = [still(engine, start + i * step) for i in range(-3, 4)]
            changes = [np.abs(b - a).max() for a, b in itertools.pairwise(pictures)]
            at_rest = 4e-3 if mode == "packed" else 2e-4
            across, around = changes[2:4], changes[:2] + changes[4:]
            assert max(across) < 1.5 * max(around) + at_rest, (start, changes)


@pytest.mark.parametrize("mode", ALL_MODES)
def test_frames_that_were_not_baked_show_the_ends(tmp_path: Path, mode: str) -> None:
    """Oracle: still pictures of the solver's first and last frame: velocities do not lead on for
    ever."""
    bake = seen(tmp_path, mode)
    frames = bake.frames[PATH]
    with Engine(Usd.Stage.Open(str(bake.target))) as engine:
        for time, frame in (
            (-40.0, frames[0]),
            (0.5, frames[0]),
            (15.0, frames[-1]),
            (99.0, frames[-1]),
        ):
            expected = stills([frame.cloud], source(bake), PATH)
            assert psnr(still(engine, time), expected) > NEARLY[mode], time


@pytest.mark.parametrize("mode", ALL_MODES)
def test_muted_results_leave_the_capture(tmp_path: Path, mode: str) -> None:
    """Oracle: the capture's own stage: its picture and what is read, bit for bit."""
    bake = seen(tmp_path, mode)
    stages = muted(bake.target), Usd.Stage.Open(str(source(bake)))
    for time in (None, 1.0, 6.5):
        pictures = []
        for stage in stages:
            with Engine(stage) as engine:
                pictures.append(still(engine, time))
        np.testing.assert_array_equal(*pictures)
        found, expected = (schema.fetch(stage.GetPrimAtPath(PATH), time) for stage in stages)
        for name in ("positions", "rotations", "scales", "opacities", "sh"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert found.ids is None
        assert found.velocities is None


def test_packed_results_do_not_ask_the_captures_arrays(tmp_path: Path) -> None:
    """Oracle: the picture before the capture's own arrays are spoilt, bit for bit."""
    bake = seen(tmp_path, "packed")
    stage = Usd.Stage.Open(str(bake.target))
    prim = stage.GetPrimAtPath(PATH)
    assert prim.GetTypeName() == schema.tokens.PACKED_TYPE
    with Engine(stage) as engine:
        before = still(engine, 3.0)
    capture = Usd.Stage.Open(str(source(bake)))
    for name in ("orientations", "scales", "opacities", "radiance:sphericalHarmonicsCoefficients"):
        attribute = capture.GetPrimAtPath(PATH).GetAttribute(name)
        attribute.Set(type(attribute.Get())(3))
    with Engine(stage) as engine:
        np.testing.assert_array_equal(still(engine, 3.0), before)


@pytest.mark.parametrize("mode", ALL_MODES)
def test_motion_vectors_point_where_splats_go(tmp_path: Path, mode: str) -> None:
    """Oracle: the solver's places before and after, by identity, carry the point that a pixel shows
    through the pinhole, to a thousandth of a pixel; those that are not there stay."""
    bake = seen(tmp_path, mode)
    with Engine(Usd.Stage.Open(str(bake.target)), time=5) as engine:
        view = engine.view(CAMERA, resolution=SIZE)
        names = ("motionForward", "motionBackward", "elementId", "depth")
        found = engine.picture(view, None, names)
        cloud = engine.render_scene.drawn()[0][1].spec.cloud
    frames = {frame.time: frame.cloud for frame in bake.frames[PATH]}
    y, x = np.nonzero(found["elementId"] >= 0)
    rows = found["elementId"][y, x]
    ids = rows if cloud.ids is None else cloud.ids[rows]
    depth = found["depth"][y, x].astype(np.float64)
    scale = SIZE[0]  # the focal length is the aperture
    middle = np.stack([x + 0.5 - SIZE[0] / 2, SIZE[1] / 2 - y - 0.5], axis=1)
    assert len(x) > 500
    for name, time, sign in (("motionForward", 6.0, 1), ("motionBackward", 4.0, -1)):
        step = np.array([_step(frames[5.0], frames[time], each) for each in ids])
        there = middle * depth[:, None] / scale + step[:, :2]
        moved = there * scale / (depth - step[:, 2])[:, None] - middle
        assert np.abs(moved).max() > 0.3
        np.testing.assert_allclose(found[name][y, x], sign * moved, atol=1e-3)


def _step(here: SplatCloud, there: SplatCloud, identity: int) -> np.ndarray:
    """How far a splat goes from one frame to another."""
    at, to = (np.flatnonzero(cloud.ids == identity) for cloud in (here, there))
    if not len(at) or not len(to):
        return np.zeros(3)
    return there.positions[to[0]].astype(np.float64) - here.positions[at[0]]
