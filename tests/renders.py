"""Pictures of bakes, and of clouds computed by an oracle, with one camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom

from tests.delegate.stages import random_cloud
from tests.render.test_sampling import psnr
from tests.sim.stage.bakes import PATH, Shot, save_stage, shot
from usdsplat import schema
from usdsplat.core import quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.render import sampling
from usdsplat.render.settings import RenderSettings
from usdsplat.sim.stage.epochs import UNBORN_SCALE
from usdsplat.sim.state import Frame

__all__ = ["add_view", "between", "blurred", "psnr", "seen", "source", "still", "stills"]

SIZE = (72, 54)
CAMERA = "/World/Camera"
AT_CENTERS = {"filter_width": 1e-4}
"""A pixel filter so narrow that only the shutter counts."""


def add_view(stage: Usd.Stage, *, eye: Sequence[float] = (0, 0, 9)) -> UsdGeom.Camera:
    """A camera that looks down -z."""
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    camera.AddTranslateOp().Set(Gf.Vec3d(*eye))
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateVerticalApertureAttr(15.0)
    camera.CreateFocalLengthAttr(20.0)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 1000.0))
    return camera


def seen(folder: Path, mode: str, **options: object) -> Shot:
    """A bake of a stage with a camera; splats drift, turn, grow, are born and die."""
    stage = save_stage(
        folder, {PATH: random_cloud(0, n=24, degree=1)}, options.pop("form", "float")
    )
    add_view(stage)
    stage.Save()
    seed = options.pop("seed", 0)
    bake = shot(folder, mode, stage=stage, lives=mode != "edit", **options)
    bake.seed = seed
    bake.run()
    return bake


def source(bake: Shot) -> Path:
    """The stage beneath a bake."""
    return bake.target.with_name("shot.usda")


def blurred(
    engine: Engine, time: float, shutter: tuple[float, float], samples: int
) -> tuple[np.ndarray, list[float]]:
    """A picture through a shutter, and the times of its samples."""
    engine.set_time(time)
    view = engine.view(CAMERA, resolution=SIZE)
    view = replace(view, camera=replace(view.camera, shutter=shutter))
    settings = RenderSettings(samples=samples, **AT_CENTERS)
    times = [time + each.time for each in sampling.samples(settings, view.camera)]
    return engine.picture(view, settings)["color"].copy(), times


def still(engine: Engine, time: float | None) -> np.ndarray:
    """A sharp picture."""
    engine.set_time(time)
    return engine.picture(engine.view(CAMERA, resolution=SIZE))["color"].copy()


def stills(clouds: Sequence[SplatCloud], source: Path, path: str) -> np.ndarray:
    """The mean of sharp pictures of clouds in the place of a field that is at `source`."""
    stage = Usd.Stage.Open(str(source))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        found = []
        with Engine(stage) as engine:
            for cloud in clouds:
                schema.author(stage, path, replace(cloud, ids=None, velocities=None))
                found.append(still(engine, None).astype(np.float64))
    return np.mean(found, axis=0)


def between(frames: Sequence[Frame], time: float, rate: float = 24.0) -> SplatCloud:
    """What a shot looks like at any time, by identity and in float64.

    Splats are on lines between frames; those that are born fade in and grow over the frame before,
    where they are born; those that die fade out where they were. Past the end velocities lead on,
    and before the beginning nothing moves.
    """
    at = [frame.time for frame in frames]
    i = int(np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 1))
    before, after = frames[i].cloud, frames[min(i + 1, len(at) - 1)].cloud
    f = time - at[i]
    if i == len(at) - 1:
        ahead = before.velocities * f / rate
        return replace(before, positions=(before.positions + ahead).astype(np.float32))
    f = max(f, 0.0)
    ids = np.union1d(before.ids, after.ids)
    old, new = _spread(before, ids), _spread(after, ids)
    born, gone = ~np.isin(ids, before.ids), ~np.isin(ids, after.ids)
    for name, array in old.items():
        array[born], new[name][gone] = new[name][born], array[gone]
    old["opacities"][born], new["opacities"][gone] = 0, 0
    old["scales"][born] = UNBORN_SCALE
    mixed = {name: (1 - f) * old[name] + f * new[name] for name in old}
    mixed["rotations"] = quaternion.slerp(old["rotations"], new["rotations"], f)
    return SplatCloud(**{name: each.astype(np.float32) for name, each in mixed.items()})


def _spread(cloud: SplatCloud, ids: np.ndarray) -> dict[str, np.ndarray]:
    """A cloud's arrays in rows of other ids, in float64."""
    arrays = {}
    for each in fields(cloud):
        value = getattr(cloud, each.name)
        if each.name not in ("ids", "velocities"):
            arrays[each.name] = np.zeros((len(ids), *value.shape[1:]))
            arrays[each.name][np.searchsorted(ids, cloud.ids)] = value
    return arrays
