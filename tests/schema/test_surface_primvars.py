"""Tests of the primvars of normals, confidence and occlusion."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from tests.schema.clouds import cloud
from usdsplat import schema


@pytest.fixture
def prim():
    """A field of ten splats."""
    stage = Usd.Stage.CreateInMemory()
    yield schema.author(stage, "/field", cloud(n=10))


def arrays(seed=0):
    """Normals, confidence and occlusion of ten splats."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(10, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    confidence, occlusion = rng.uniform(0, 1, (2, 10))
    return {
        "normals": np.float32(normals),
        "confidence": np.float32(confidence),
        "occlusion": np.float32(occlusion),
    }


def test_they_are_read_as_written(prim) -> None:
    """Oracle: the arrays; half precision has 11 bits."""
    written = arrays()
    schema.author_surface(prim, **written)
    found = schema.fetch_surface(prim, 10)
    for name, expected in written.items():
        np.testing.assert_allclose(getattr(found, name), expected, atol=2**-11)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-6)


def test_a_field_without_them_has_none(prim) -> None:
    """Oracle: closed form."""
    found = schema.fetch_surface(prim, 10)
    assert (found.normals, found.confidence, found.occlusion) == (None, None, None)


def test_long_arrays_are_truncated_and_short_ones_ignored(prim) -> None:
    """Oracle: the stock schema's rule for arrays of splats."""
    schema.author_surface(prim, **arrays())
    np.testing.assert_array_equal(
        schema.fetch_surface(prim, 7).normals, schema.fetch_surface(prim, 10).normals[:7]
    )
    assert schema.fetch_surface(prim, 11).normals is None


def test_samples_are_read_at_their_times(prim) -> None:
    """Oracle: the arrays."""
    for time in (1, 2):
        schema.author_surface(prim, **arrays(time), time=time)
        found = schema.fetch_surface(prim, 10, time).occlusion
        np.testing.assert_allclose(found, arrays(time)["occlusion"], atol=2**-11)


def test_normals_of_other_programs_are_read(prim) -> None:
    """Single precision, not of unit length, some of them no directions. Oracle: closed form."""
    attribute = prim.CreateAttribute("primvars:normals", Sdf.ValueTypeNames.Normal3fArray)
    vectors = np.tile(np.float32([0, 3, 4]), (10, 1))
    vectors[4], vectors[5] = 0, np.nan
    attribute.Set(Vt.Vec3fArray.FromNumpy(vectors))
    found = schema.fetch_surface(prim, 10).normals
    np.testing.assert_allclose(found[[0, 9]], [[0, 0.6, 0.8]] * 2, atol=1e-6)
    assert not found[[4, 5]].any()


def test_values_of_another_type_are_no_normals(prim) -> None:
    """Oracle: closed form."""
    attribute = prim.CreateAttribute("primvars:normals", Sdf.ValueTypeNames.IntArray)
    attribute.Set(Vt.IntArray([1] * 10))
    assert schema.fetch_surface(prim, 10).normals is None
