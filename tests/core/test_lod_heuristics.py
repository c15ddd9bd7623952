"""Tests of levels of detail by size and distance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Gf, Vt

from usdsplat.core.lod_heuristics import LodHeuristic, LodView, nearest_index

UsdLod = pytest.importorskip("pxr.UsdLod", reason="USD has UsdLod since 26.8")

SIZES = (0.25, 0.1, 0.025)
SIZE_BLENDS = (0.2, 0.08, 0.02)
DISTANCES = (10.0, 50.0, 100.0)
DISTANCE_BLENDS = (11.0, 55.0, 110.0)
METHODS = {"sphere": "projectedSphere", "box": "projectedExtent"}


def frustum_of(rng: np.random.Generator, orthographic: bool) -> Gf.Frustum:
    """A random camera that looks at the origin."""
    eye = rng.normal(size=3)
    eye *= rng.uniform(3, 60) / np.linalg.norm(eye)
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(0, 0, 0), Gf.Vec3d(0, 1, 0))
    half = Gf.Vec2d(rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.8)) * (20 if orthographic else 1)
    window = Gf.Range2d(-half, half)
    kind = Gf.Frustum.Orthographic if orthographic else Gf.Frustum.Perspective
    return Gf.Frustum(look.GetInverse(), window, Gf.Range1d(0.1, 1000), kind)


def view_of(frustum: Gf.Frustum) -> LodView:
    """The same camera in our terms."""
    clip = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    size = frustum.GetWindow().GetSize()
    return LodView(
        eye=tuple(frustum.GetPosition()),
        window=(size[0], size[1]),
        to_clip=np.array(clip).T,
        is_orthographic=frustum.GetProjectionType() == Gf.Frustum.Orthographic,
    )


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("metric", ["sphere", "box"])
@pytest.mark.parametrize("blend", [(), SIZE_BLENDS, SIZE_BLENDS[:1]])
def test_levels_by_size_are_those_of_usdlod(metric: str, orthographic: bool, blend) -> None:
    """Oracle: `UsdLod.ScreenSizeHeuristicQuery`, for random cameras and places in the picture."""
    rng = np.random.default_rng(6)
    levels = set()
    for _ in range(200):
        frustum = frustum_of(rng, orthographic)
        low, high = -rng.uniform(0.2, 2, 3), rng.uniform(0.2, 2, 3)
        matrix = Gf.Matrix4d().SetTranslate(Gf.Vec3d(*rng.normal(size=3) * 0.2))
        matrix = Gf.Matrix4d().SetScale(rng.uniform(0.5, 2)) * matrix
        extent = Gf.Range3d(Gf.Vec3d(*low), Gf.Vec3d(*high))
        args = (Vt.FloatArray(SIZES), Vt.FloatArray(blend))
        query = UsdLod.ScreenSizeHeuristicQuery("imaging", extent, METHODS[metric], *args)
        expected = query.ComputeLOD(query.ComputeScreenSize(frustum, matrix))
        ours = LodHeuristic(
            metric=metric,
            low=tuple(low),
            high=tuple(high),
            thresholds=tuple(map(float, np.float32(SIZES))),
            blend_thresholds=tuple(map(float, np.float32(blend))),
        ).level(view_of(frustum), np.array(matrix).T)
        assert ours == pytest.approx(expected, abs=1e-4)
        levels.add(round(expected))
    assert levels == {0, 1, 2, 3}


@pytest.mark.parametrize("metric", ["sphere", "box"])
def test_a_box_that_the_camera_is_inside_has_the_first_item(metric: str) -> None:
    """Oracle: it fills the picture; the near plane cuts it."""
    frustum = Gf.Frustum(Gf.Matrix4d(1), Gf.Range2d((-0.3, -0.2), (0.3, 0.2)), Gf.Range1d(0.1, 9),
                         Gf.Frustum.Perspective)  # fmt: skip
    box = LodHeuristic(metric=metric, low=(-1,) * 3, high=(1,) * 3, thresholds=SIZES)
    assert box.level(view_of(frustum), np.eye(4)) == 0


def test_a_box_behind_the_camera_has_the_last_item() -> None:
    """Oracle: the near plane cuts all of it."""
    frustum = Gf.Frustum(Gf.Matrix4d(1), Gf.Range2d((-1, -1), (1, 1)), Gf.Range1d(0.1, 9),
                         Gf.Frustum.Perspective)  # fmt: skip
    box = LodHeuristic(metric="box", low=(-1, -1, 3), high=(1, 1, 4), thresholds=SIZES)
    assert box.level(view_of(frustum), np.eye(4)) == 3


@pytest.mark.parametrize("blend", [(), DISTANCE_BLENDS])
@pytest.mark.parametrize("with_box", [False, True])
def test_levels_by_distance_are_those_of_usdlod(with_box: bool, blend) -> None:
    """Oracle: `UsdLod.DistanceHeuristicQuery`."""
    rng = np.random.default_rng(7)
    levels = set()
    for _ in range(100):
        frustum = frustum_of(rng, False)
        eye = Gf.Vec3d(*(np.array(frustum.GetPosition()) * 2.5))
        matrix = Gf.Matrix4d().SetTranslate(Gf.Vec3d(*rng.normal(size=3)))
        low, high = (-1.0, -2.0, -3.0), (1.0, 1.0, 2.0)
        query = UsdLod.DistanceHeuristicQuery()
        query.thresholds, query.blendThresholds = Vt.FloatArray(DISTANCES), Vt.FloatArray(blend)
        if with_box:
            query.extent = Gf.Range3d(Gf.Vec3d(*low), Gf.Vec3d(*high))
        else:
            low = high = (1.0, 2.0, 3.0)
            query.center = Gf.Vec3f(1, 2, 3)
        expected = query.ComputeLOD(query.ComputeDistance(eye, matrix))
        view = LodView(eye=tuple(eye), window=(1, 1), to_clip=np.eye(4))
        ours = LodHeuristic(
            metric="distance", low=low, high=high, thresholds=DISTANCES, blend_thresholds=blend
        ).level(view, np.array(matrix).T)
        assert ours == pytest.approx(expected, abs=1e-5)
        levels.add(round(expected))
    assert levels >= {0, 1, 2, 3} - ({0} if not with_box else set())


@pytest.mark.parametrize(
    ("level", "index"),
    [(-3, 0), (0.4, 0), (0.5, 1), (1.2, 1), (1.5, 2), (7, 2), (math.inf, 2), (math.nan, 0)],
)
def test_a_level_is_clamped_and_rounded(level: float, index: int) -> None:
    """Oracle: LODOverrideAPI's documentation: clamped into range, rounded to the nearest."""
    assert nearest_index(level, 3) == index
