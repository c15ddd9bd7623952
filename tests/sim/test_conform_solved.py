"""Tests of conforming after other stages."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import placed, rotation
from tests.sim.recipes import Written, always, ball, deformer, knobs, played
from tests.sim.shapes import sphere
from usdsplat.core import edit
from usdsplat.kernels.devices import open_device


@pytest.mark.parametrize("mode", ["closest", "normalRay"])
def test_splats_that_were_turned_before_go_on_from_there(mode: str) -> None:
    """Oracle: the capture through the deformer's matrix by core.edit. It is a ball, so on a sphere
    about it splats have the same directions, and lie there as they are; a sphere of triangles is
    0.04 and 4 degrees off."""
    p = knobs(conform={"weight": 1.0, "duration": 0.0, "stagger": 0.0, "mode": mode})
    turn = deformer("transform", rotate=(90.0, 0.0, 0.0))
    says = always(parameters=p, target=sphere(3, 1.3), deformers=(turn,))
    rest = ball(300)
    expected = edit.transform(rest, placed((0, 0, 0), rotation((1, 0, 0), np.pi / 2)))
    for frame in played(open_device(), Written(rest, says), 2):
        places = frame.cloud.positions
        places = places / np.linalg.norm(places, axis=1, keepdims=True)
        np.testing.assert_allclose(places, expected.positions, atol=0.05)
        cosines = np.abs(np.einsum("ni,ni->n", frame.cloud.rotations, expected.rotations))
        assert cosines.min() > np.cos(np.radians(5))
