"""Tests of pictures of a stage from three sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core import axes
from usdsplat.core.cloud import SplatCloud
from usdsplat.products.report.views import SIDE, views

COLORS = np.eye(3)
"""Red is to the right, green above, blue towards who looks from the front."""


def jack() -> SplatCloud:
    """Three balls on the axes right, up and back, and many dark ones in the middle."""
    rng = np.random.default_rng(0)
    n = 200
    positions = np.concatenate([np.repeat(np.eye(3), 20, axis=0), rng.normal(0, 0.05, (n, 3))])
    colors = np.concatenate([np.repeat(COLORS, 20, axis=0), np.zeros((n, 3))])
    return SplatCloud(
        positions=positions.astype(np.float32),
        scales=np.full((n + 60, 3), 0.02, np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n + 60, 1)),
        opacities=np.full(n + 60, 0.95, np.float32),
        sh=((colors[:, None] - 0.5) / 0.28209479).astype(np.float32),
    )


def middle(pixels: np.ndarray, channel: int) -> tuple[float, float]:
    """Where a colour is in a picture, right and up of its middle, -1 to 1."""
    others = np.delete(pixels.astype(float), channel, axis=2).max(axis=2)
    weight = np.maximum(pixels[..., channel] - others - 60, 0)
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    x, y = (float((weight * at).sum() / weight.sum()) for at in (columns, rows))
    return 2 * x / SIDE - 1, 1 - 2 * y / SIDE


@pytest.mark.parametrize(("up_axis", "frame"), [("Y", "rub"), ("Z", "rfu")])
def test_pictures_show_the_sides_that_they_are_named_after(up_axis: str, frame: str) -> None:
    """Oracle: where right, up and back are on each side of a thing, by words."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, up_axis)
    cloud = jack()
    turn = axes.change("rub", frame).astype(np.float32)
    schema.author(stage, "/Jack", replace(cloud, positions=cloud.positions @ turn.T))
    front, right, top = views(stage, None, frame)
    where = {
        side.title.partition(":")[0]: [middle(side.pixels, channel) for channel in range(3)]
        for side in (front, right, top)
    }
    unit = 2 * front.bar / float(front.bar_text)  # of the world, where the picture is 2 wide
    for side, one, other, expected in (
        ("front", 0, 1, (1, -1)),
        ("right", 2, 1, (-1, -1)),
        ("top", 0, 2, (1, 1)),
    ):
        apart = np.subtract(where[side][one], where[side][other])
        np.testing.assert_allclose(apart, np.multiply(expected, unit), atol=0.01, err_msg=side)
    names = {"rub": ("x right, y up", "-z right, y up", "x right, -z up")}
    names["rfu"] = ("x right, z up", "y right, z up", "x right, y up")
    assert [side.title.partition(": ")[2] for side in (front, right, top)] == list(names[frame])
