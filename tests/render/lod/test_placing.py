"""Tests of where the instances of a tree are in the samples of a picture."""

from __future__ import annotations

import numpy as np

from usdsplat.render.lod.placing import Placed
from usdsplat.render.specs import InstanceSpec


def test_samples_with_the_same_instances_share_what_is_computed():
    """Oracle: the objects; and NumPy's singular values of a scaled instance."""
    some = (InstanceSpec(path="/a", transform=tuple(np.diag([3.0, 2.0, 1.0, 1.0]).ravel())),)
    moved = (*some, InstanceSpec(path="/b"))
    placed = Placed.of((some, moved, some))
    first, second, third = placed.placings
    assert first is third and first is not second
    assert placed.rows == {("/a", 0): 0, ("/b", 0): 1}
    np.testing.assert_allclose(first.scales[0], (3, 1))
    assert np.isnan(first.transforms[1]).all() and np.isfinite(second.transforms).all()
    assert placed.is_of((some, moved, some)) and not placed.is_of((some, some, moved))
