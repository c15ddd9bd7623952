"""NumPy to Vt and back."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Vt

from usdsplat.schema.vt import from_vt, to_vt


@pytest.mark.parametrize(
    ("kind", "shape", "dtype"),
    [
        (Vt.FloatArray, (5,), np.float32),
        (Vt.HalfArray, (5,), np.float16),
        (Vt.Int64Array, (5,), np.int64),
        (Vt.Vec3fArray, (5, 3), np.float32),
        (Vt.Vec3hArray, (5, 3), np.float16),
        (Vt.Vec4iArray, (5, 4), np.int32),
    ],
)
def test_arrays_arrive_as_usds_own_conversion_makes_them(kind, shape, dtype) -> None:
    """Oracle: `FromNumpy` of Vt."""
    array = np.random.default_rng(0).normal(0, 100, shape).astype(dtype)
    assert to_vt(array, kind) == kind.FromNumpy(array)


def test_quaternions_change_order_on_the_way() -> None:
    """Oracle: Gf, whose constructor takes the real part first."""
    array = np.float32([[1, 2, 3, 4], [5, 6, 7, 8]])
    made = to_vt(array, Vt.QuatfArray)
    assert made[0] == Gf.Quatf(1, 2, 3, 4)
    assert made[1].GetReal() == 5
    np.testing.assert_array_equal(from_vt(made), array)
    assert from_vt(made).flags.c_contiguous


def test_half_is_rounded_to_nearest() -> None:
    """Oracle: NumPy's conversion, and Gf's real part."""
    array = np.float32([[0.1, 0.2, 0.3, 0.4]])
    made = to_vt(array, Vt.QuathArray)
    np.testing.assert_array_equal(from_vt(made), array.astype(np.float16))
    assert made[0].GetReal() == np.float16(0.1)


def test_strided_and_wider_arrays_are_taken() -> None:
    """Oracle: element by element."""
    wide = np.arange(24, dtype=np.float64).reshape(4, 6)[:, ::2]
    assert [tuple(v) for v in to_vt(wide, Vt.Vec3fArray)] == [tuple(row) for row in wide]


def test_reading_is_a_read_only_view() -> None:
    """Oracle: NumPy's own flags."""
    array = from_vt(Vt.Vec3fArray([(1, 2, 3)]))
    assert not array.flags.owndata
    assert not array.flags.writeable


@pytest.mark.parametrize("kind", [Vt.Vec3fArray, Vt.QuatfArray, Vt.FloatArray])
def test_nothing_becomes_nothing(kind) -> None:
    """Oracle: the length."""
    width = {Vt.Vec3fArray: (0, 3), Vt.QuatfArray: (0, 4), Vt.FloatArray: (0,)}[kind]
    assert len(to_vt(np.empty(width, np.float32), kind)) == 0


def test_a_wrong_shape_is_refused() -> None:
    """Oracle: the documented error."""
    with pytest.raises(ValueError, match="found shape"):
        to_vt(np.zeros((3, 2), np.float32), Vt.Vec3fArray)


def test_real_numbers_do_not_become_whole_ones() -> None:
    """Oracle: NumPy's same_kind rule."""
    with pytest.raises(TypeError):
        to_vt(np.zeros((3, 4), np.float32), Vt.Vec4iArray)
