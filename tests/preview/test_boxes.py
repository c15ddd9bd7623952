"""Tests of boxes of prims for outlines, framing and clipping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pxr import UsdGeom

from tests.delegate.stages import random_cloud
from tests.preview.documents import STATE, drawn_by
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.preview import boxes

SHIFT = (2.0, 0.0, 0.0)


def test_boxes_are_those_of_what_is_drawn_beneath(document, events, stage):
    """Oracle: NumPy's corners of the centres: of one prim along its own axes, of several along
    the world's; of a light that is not drawn what USD says, and nothing of what is not there."""
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/World/A"))
    op.AddRotateZOp().Set(30.0)
    UsdGeom.Sphere.Define(stage, "/Hidden").CreateRadiusAttr(2.0)
    UsdGeom.Imageable(stage.GetPrimAtPath("/Hidden")).MakeInvisible()
    selected = ("/World/A", "/World", "/Nobody", "/Hidden")
    drawn_by(document, replace(STATE, selected=selected))
    one, both, hidden = (np.array(each) for each in events.pictures[-1].boxes)
    a, b = random_cloud(1).positions.astype(float), random_cloud(2).positions + SHIFT
    low, high = np.quantile(a, (0.004, 0.996), axis=0)
    turn = np.array([[np.cos(np.pi / 6), -np.sin(np.pi / 6), 0],
                     [np.sin(np.pi / 6), np.cos(np.pi / 6), 0], [0, 0, 1]])  # fmt: skip
    np.testing.assert_allclose(one[0], turn @ low, atol=1e-5)
    np.testing.assert_allclose(one[7], turn @ high, atol=1e-5)
    np.testing.assert_allclose(one[1], turn @ (high[0], low[1], low[2]), atol=1e-5)
    lows, highs = np.quantile(b, (0.004, 0.996), axis=0)
    np.testing.assert_allclose(both[7], np.maximum(one.max(axis=0), highs), atol=1e-5)
    np.testing.assert_allclose(both[0], np.minimum(one.min(axis=0), lows), atol=1e-5)
    np.testing.assert_allclose((hidden[0], hidden[7]), ((-2, -2, -2), (2, 2, 2)), atol=1e-6)


def test_bounds_are_for_framing(document, stage):
    """Oracle: the boxes; all of them without a path, None where nothing is."""
    box = document.bounds(("/World/B",))
    low, high = np.quantile(random_cloud(2).positions + SHIFT, (0.004, 0.996), 0)
    np.testing.assert_allclose(box, (low, high), atol=1e-5)
    everything, world = document.bounds(), document.bounds(("/World",))
    np.testing.assert_allclose(everything, world, atol=1e-5)
    assert document.bounds(("/Nobody",)) is None


def test_all_that_may_be_seen_is_within_reach(stage):
    """Oracle: the conservative extent that files hold; splats that are not finite do not count."""
    cloud = random_cloud(4)
    cloud.positions[3] = np.nan
    schema.author(stage, "/World/C", cloud)
    with Engine(stage) as engine:
        low, high = boxes.Reach().of(engine.render_scene)
        inner = engine.render_scene.bounds()
        assert (low <= inner[0]).all() and (high >= inner[1]).all()
        assert np.isfinite(low).all() and np.isfinite(high).all()
