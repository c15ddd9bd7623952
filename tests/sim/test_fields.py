"""Tests of distance fields of meshes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import icosphere
from usdsplat.core.errors import UsageError
from usdsplat.kernels.devices import open_device
from usdsplat.sim.fields import BAND, Fields, bake_field
from usdsplat.sim.specs import Surface


def centres(field) -> np.ndarray:
    """Of all voxels, shape (nz, ny, nx, 3)."""
    z, y, x = np.indices(field.distances.shape)
    return field.low + field.voxel * np.stack((x, y, z), axis=-1)


def test_a_ball() -> None:
    """Oracle: the ball. A mesh of it is nearer by the chords' sagitta, and distances far from it
    are too large by a small part of a voxel."""
    field = bake_field(open_device(), icosphere(4, 1.0), 0.06)
    found, exact = field.distances, np.linalg.norm(centres(field), axis=-1) - 1
    sagitta = 0.002
    band = np.abs(exact) < (BAND - 0.5) * field.voxel
    assert np.abs(found - exact)[band].max() < sagitta
    assert np.abs(found - exact).max() < sagitta + 0.05 * field.voxel
    assert ((found < 0) == (exact < 0))[np.abs(exact) > sagitta].all()
    low, high = field.box
    assert low == pytest.approx([-1, -1, -1], abs=sagitta)
    assert (field.low <= low - 2.9 * field.voxel).all()
    assert high == pytest.approx([1, 1, 1], abs=sagitta)


def test_an_open_mesh_has_an_inside() -> None:
    """Oracle: the ball, away from the hole."""
    ball = icosphere(3, 1.0)
    middles = ball.points[ball.triangles].mean(axis=1)
    bowl = Surface(points=ball.points, triangles=ball.triangles[middles[:, 2] < 0.8])
    field = bake_field(open_device(), bowl, 0.1)
    places = centres(field)
    radius = np.linalg.norm(places, axis=-1)
    clear = (places[..., 2] < 0.4) & (np.abs(radius - 1) > 0.05)
    assert ((field.distances < 0) == (radius < 1))[clear].all()


def test_a_flat_mesh_has_a_field() -> None:
    """Oracle: closed form of the distance from a square; nothing is inside of it."""
    square = Surface(
        points=np.float32([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]),
        triangles=np.int32([(0, 1, 2), (0, 2, 3)]),
    )
    field = bake_field(open_device(), square)
    assert field.voxel == pytest.approx(2 / 64)
    places = centres(field)
    beyond = np.maximum(np.abs(places) - [1, 1, 0], 0)
    exact = np.linalg.norm(beyond, axis=-1)
    assert np.abs(np.abs(field.distances) - exact).max() < 1e-5


def test_too_fine_a_field_is_refused() -> None:
    """Oracle: the sentence, whose advice works."""
    with pytest.raises(UsageError, match=r"/ball voxelSize: found 0\.001, .* expected 0\.0") as no:
        bake_field(open_device(), icosphere(1, 1.0), 0.001, where="/ball")
    assert float(no.value.expected.split()[0]) == pytest.approx(2 / (256 - 8), rel=0.1)


def test_the_same_arrays_are_baked_once() -> None:
    """Oracle: identity. What the last table did not need is forgotten."""
    fields = Fields(open_device())
    ball, other = icosphere(1), icosphere(2)
    first = fields.of(ball, 0.2, "/a")
    again = Surface(points=ball.points, triangles=ball.triangles)
    assert fields.of(again, 0.2, "/a") is first
    assert fields.of(ball, 0.3, "/a") is not first
    second = fields.of(other, 0.2, "/b")
    table = fields.table([first, second])
    assert fields.table([first, second]) is table
    start = int(table.headers[1, -1])
    assert (table.voxels[start:] == second.distances.reshape(-1)).all()
    assert fields.of(ball, 0.2, "/a") is first
    fields.table([second])
    assert fields.of(ball, 0.2, "/a") is not first
