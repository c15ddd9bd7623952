"""Tests of authored normals of splats on a stage."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd

from tests.kernels.points.splat_shapes import sphere
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.render.settings import RenderSettings


def ball(count=300):
    """A sphere of splats."""
    positions, rotations, scales, opacities = sphere(count).splats
    sh = np.zeros((count, 1, 3), np.float32)
    return SplatCloud(
        positions=positions, rotations=rotations, scales=scales, opacities=opacities, sh=sh
    )


def values(normal, count=300):
    """The same normal for all splats."""
    return {
        "normals": np.tile(np.float32(normal), (count, 1)),
        "confidence": np.ones(count, np.float32),
        "occlusion": np.zeros(count, np.float32),
    }


def mean(engine):
    """The mean of N in camera space, of pixels that splats cover."""
    view = engine.view(resolution=(40, 40))
    found = engine.picture(view, RenderSettings(color_mode="scene"), ("Neye", "color"))
    return np.asarray(found["Neye"])[np.asarray(found["color"])[..., 3] > 0.9].mean(axis=0)


@pytest.mark.parametrize("form", ["float", "packed"])
def test_authored_normals_are_drawn_and_edits_seen(form) -> None:
    """Oracle: the authored vectors, whose length in pictures is that of their mean; a fresh
    engine after each edit."""
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/ball", ball(), form=form)
    with Engine(stage) as engine:
        computed = mean(engine)
        assert np.linalg.norm(computed) < 0.97  # those of a sphere differ
        for normal in ((1, 0, 0), (0, 0, 1)):
            schema.author_surface(prim, **values(normal))
            found = mean(engine)
            assert np.linalg.norm(found) == pytest.approx(1, abs=1e-3)
            with Engine(stage) as fresh:
                np.testing.assert_array_equal(found, mean(fresh))
        prim.RemoveProperty("primvars:normals")
        np.testing.assert_array_equal(mean(engine), computed)


def test_normals_of_the_rest_pose_are_not_those_of_moving_splats() -> None:
    """Oracle: normals computed at the time, as without the primvars; with samples, the authored
    ones."""
    stage = Usd.Stage.CreateInMemory()
    for time in (1, 2):
        prim = schema.author(stage, "/ball", ball(), time=time)
    with Engine(stage, time=1.0) as engine:
        computed = mean(engine)
    schema.author_surface(prim, **values((1, 0, 0)))
    with Engine(stage, time=1.0) as engine:
        np.testing.assert_array_equal(mean(engine), computed)
    for time in (1, 2):
        schema.author_surface(prim, **values((1, 0, 0)), time=time)
    with Engine(stage, time=1.0) as engine:
        assert np.linalg.norm(mean(engine)) == pytest.approx(1, abs=1e-3)
