"""Tests of seams: where nodes at different levels of a built tree adjoin, on a textured wall.

Nodes divide the wall at planes. On its border, a pixel sees one half of the kernels of coarse
splats and the other half of those of fine ones. Each level alone is right there, because the errors
of both of its halves cancel; those of halves of different sizes do not. So single pixels within two
pixels of a border are worse than the same pixels of both levels, by up to 12/255 here, whatever the
nodes' margins: see the first test. But no hole appears, and no pixel is notably worse than the
worst ones beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from tests.render.rendering import picture, scene_of
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.node_cuts import heights
from usdsplat.core.sh import rgb_to_dc
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.files import open_stage
from usdsplat.interchange.lod import LodOptions, build_tree
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, View

EDGE, SIZE, FINE = 64, 64, 8
"""Splats along an edge of the wall, pixels of a picture, and samples of the mean."""
CLOSE = (0.1, 10.0)
GRADIENT = 1.4
"""Largest change of the wall's colours [1/unit]."""


def wall(opacity: float) -> SplatCloud:
    """Overlapping discs on a square of edge 2, with a smooth texture; their places are uneven."""
    x, y = (each.ravel() for each in np.meshgrid(*2 * [(np.arange(EDGE) + 0.5) / EDGE * 2 - 1]))
    step, n = 2 / EDGE, EDGE * EDGE
    moved = np.random.default_rng(0).uniform(-0.2, 0.2, (n, 2)) * step
    texture = np.stack([np.sin(5 * x), np.sin(4 * y), np.sin(3 * (x + y))], axis=1)
    return SplatCloud(
        positions=np.stack([x + moved[:, 0], y + moved[:, 1], 0 * x], axis=1).astype(np.float32),
        scales=np.tile(np.float32([0.75 * step, 0.75 * step, 0.02 * step]), (n, 1)),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.full(n, opacity, np.float32),
        sh=texture[:, None].astype(np.float32),
    )


class Wall:
    """Pictures of a tree of a wall that is refined down to given nodes."""

    def __init__(self, engine):
        [(_, self._tree)] = engine.render_scene.drawn_trees()
        self._engine, self._number = engine, 0
        self.table = self._tree.spec.table
        ahead = np.eye(4)
        ahead[2, 3] = -3
        placed = np.reshape(self._tree.instances[0].transform, (4, 4))
        self._camera = CameraSpec(
            world_to_camera=tuple(map(float, (ahead @ np.linalg.inv(placed)).ravel())),
            orthographic=True,
            window=(-0.8, -0.8, 0.8, 0.8),
            clipping_range=CLOSE,
        )

    def draw(self, closed, size=SIZE):
        """A picture whose cut is not refined below the nodes `closed`, with 16 samples a pixel."""
        self._tree.closed = set(map(int, closed))
        self._number += 1  # a new view, so that no result of another cut is reused
        far = CLOSE[1] + 1e-3 * self._number
        camera = replace(self._camera, clipping_range=(CLOSE[0], far))
        view = View(camera=camera, framing=Framing(resolution=(size, size)))
        how = RenderSettings(sorting="zDepth", color_mode="display", lod_error=0.0, lod_samples=4)
        return np.concatenate([b.arrays["color"].copy() for b in self._engine.render(view, how)])


def worst_beside(errors):
    """The largest value within two pixels of each."""
    return sliding_window_view(np.pad(errors, 2), (5, 5)).max(axis=(-2, -1))


def ramp(step, low, high):
    """Translucent discs on x in [low, high], y in [-2, 2], as grey as 0.5 + GRADIENT x."""
    x, y = (np.arange(a + step / 2, b, step) for a, b in ((low, high), (-2.0, 2.0)))
    x, y = (each.ravel() for each in np.meshgrid(x, y))
    n, grey = len(x), (0.5 + GRADIENT * x).astype(np.float32)
    return SplatCloud(
        positions=np.stack([x, y, np.full(n, -5.0)], axis=1).astype(np.float32),
        scales=np.tile(np.float32([0.75 * step, 0.75 * step, 1e-3]), (n, 1)),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.full(n, 0.1, np.float32),
        sh=rgb_to_dc(np.repeat(grey, 3).reshape(n, 1, 3)),
    )


def grey_at_border(*clouds):
    """The grey of the splats at x = 0, relative to that of the ramp [1/255]."""
    eye = CameraSpec(
        world_to_camera=tuple(np.eye(4).ravel().tolist()),
        orthographic=True,
        window=(-0.5, -0.5, 0.5, 0.5),
        clipping_range=CLOSE,
    )
    view = View(camera=eye, framing=Framing(resolution=(500, 500)))
    parts = [(each, np.eye(4)) for each in clouds]
    color = picture(scene_of(*parts), view, aovs=("color",))["color"]
    middle = color[150:350, 249:251].mean(axis=(0, 1))
    return 255 * (middle[0] / middle[3] - 0.5)


def test_a_border_of_two_levels_is_worse_than_both():
    """Why the errors of single pixels cannot be those of either level. Oracle: the mean of a ramp
    under a half of a Gaussian of deviation s is off by gradient * s / sqrt(2 pi); a whole one is
    right."""
    coarse, fine = 0.1, 0.05
    for step in (coarse, fine):
        assert abs(grey_at_border(ramp(step, -2, 2))) < 1
    sides = ramp(coarse, -2, 0), ramp(fine, 0, 2)
    # splats of equal depth are in the order of their fields: the mean of both hides neither side
    mixed = 0.5 * (grey_at_border(*sides) + grey_at_border(*reversed(sides)))
    expected = -255 * GRADIENT * 0.75 * (coarse - fine) / np.sqrt(2 * np.pi)
    assert expected < -5
    assert mixed == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("opacity", [0.98, 0.3])
def test_seams_of_a_wall(opacity, tmp_path):
    """Cuts with coarse nodes on one side of each border, and finer ones on the other. Oracle: the
    mean of the leaves, drawn with 64 samples a pixel, and the pictures of either level alone: the
    worst error and the least coverage within two pixels."""
    formats.write(wall(opacity), tmp_path / "wall.ply")
    options = LodOptions(leaf_splats=256, pixel=0.0, axes="rub")
    build_tree(tmp_path / "wall.ply", tmp_path / "wall.usda", options=options)
    with Engine(open_stage(tmp_path / "wall.usda"), device="cpu") as engine:
        pictures = Wall(engine)
        table, above = pictures.table, heights(pictures.table)
        fine_picture = pictures.draw([], FINE * SIZE).reshape(SIZE, FINE, SIZE, FINE, 4)
        truth = fine_picture.mean(axis=(1, 3))
        borders = 0
        for height in range(1, int(above.max())):
            coarse, fine = (np.flatnonzero(above == each) for each in (height, height - 1))
            alone = [pictures.draw(each) for each in (coarse, fine)]
            errors = [np.abs(each - truth).max(axis=-1) for each in alone]
            most = worst_beside(np.maximum(*errors))
            clear = worst_beside(np.maximum(*(1 - each[..., 3] for each in alone)))
            for axis in (0, 1):
                middle = 0.5 * (table.low[coarse, axis] + table.high[coarse, axis])
                left = coarse[middle < np.median(middle) + 1e-6]
                assert 0 < len(left) < len(coarse)
                mixed = pictures.draw([*left, *fine])
                worse = np.abs(mixed - truth).max(axis=-1) - most
                assert worse.max() < 3 / 255, (height, axis)
                assert (1 - mixed[..., 3] - clear).max() < 1 / 255, (height, axis)
                borders += 1
        assert borders >= 2
