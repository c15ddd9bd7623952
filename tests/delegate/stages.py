"""Small clouds and stages, created in memory."""

from __future__ import annotations

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.render.specs import FieldSpec


def random_cloud(seed: int = 0, *, n: int = 12, degree: int = 1, spread: float = 1.0) -> SplatCloud:
    """Splats of all orientations around the origin, none of them round."""
    rng = np.random.default_rng(seed)
    rotations = rng.normal(size=(n, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    arrays = {
        "positions": spread * rng.normal(size=(n, 3)),
        "scales": rng.uniform(0.05, 0.4, size=(n, 3)),
        "rotations": rotations,
        "opacities": rng.uniform(0.3, 1.0, size=n),
        "sh": 0.4 * rng.normal(size=(n, (degree + 1) ** 2, 3)),
    }
    return SplatCloud(**{name: array.astype(np.float32) for name, array in arrays.items()})


def two_fields(first: str = "/World/A", second: str = "/World/B") -> Usd.Stage:
    """Two clouds under a root Xform, the second one beside the first."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/World")
    schema.author(stage, first, random_cloud(1))
    prim = schema.author(stage, second, random_cloud(2))
    UsdGeom.Xformable(prim).AddTranslateOp().Set((2, 0, 0))
    return stage


def add_camera(
    stage: Usd.Stage, path: str = "/Camera", *, eye: tuple[float, float, float] = (0.0, 0.0, 10.0)
) -> UsdGeom.Camera:
    """A camera that looks down -z."""
    camera = UsdGeom.Camera.Define(stage, path)
    camera.AddTranslateOp().Set(Gf.Vec3d(*eye))
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateVerticalApertureAttr(15.0)
    camera.CreateFocalLengthAttr(20.0)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 1000.0))
    return camera


def contents(engine: Engine) -> list[tuple[object, ...]]:
    """All that an engine would draw, in the order of drawing, down to the last bit."""
    engine.sync()
    return [
        (
            path,
            *_hints(field.spec),
            instance,
            field.crops,
            *_bytes(field.spec.cloud),
            field.spec.grade,
        )
        for path, field, instance in engine.render_scene.drawn()
    ]


def _hints(spec: FieldSpec) -> tuple[str, ...]:
    return spec.color_space, spec.rasterize_mode, spec.projection_mode, spec.sorting_mode


def _bytes(cloud: SplatCloud) -> tuple[bytes | None, ...]:
    names = ("positions", "scales", "rotations", "opacities", "sh", "ids", "velocities")
    arrays = (getattr(cloud, name) for name in names)
    return tuple(None if array is None else array.tobytes() for array in arrays)
