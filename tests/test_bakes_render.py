"""What was simulated is what is seen, at frames, between them, and through any shutter."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.delegate.stages import random_cloud
from tests.renders import add_view, between, blurred, psnr, still, stills
from tests.sim.stage.bakes import PATH, Shot, save_stage, shot
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


def seen(folder: Path, mode: str, **options: object) -> Shot:
    """A bake of a stage with a camera; splats drift, turn, grow, are born and die."""
    stage = save_stage(
        folder, {PATH: random_cloud(0, n=24, degree=1)}, options.pop("form", "float")
    )
    add_view(stage)
    stage.Save()
    bake = shot(folder, mode, stage=stage, lives=mode != "edit", **options)
    bake.run()
    return bake


def source(bake: Shot) -> Path:
    """The stage beneath a bake."""
    return bake.target.with_name("shot.usda")


def muted(target: Path) -> Usd.Stage:
    """The stage of a bake, its results muted."""
    stage = Usd.Stage.Open(str(target))
    root = stage.GetRootLayer()
    stage.MuteLayer(Sdf.ComputeAssetPathRelativeToLayer(root, root.subLayerPaths[0]))
    return stage


@pytest.mark.parametrize("mode", ALL_MODES)
def test_any_shutter_sees_the_frames_and_what_is_between(tmp_path: Path, mode: str) -> None:
    """Oracle: the mean of still pictures of the solver's own frames, mixed by identity in float64;
    beyond the last frame velocities lead on, and of mode edit, which has none, all is held."""
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
