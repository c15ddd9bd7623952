"""Tests of converting NumPy arrays to Vt arrays and back."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from usdsplat.schema.vt import empty, from_vt, to_vt


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


@pytest.mark.parametrize(
    ("shape", "flat", "dtype", "kind"),
    [
        ((5,), (5,), np.float32, Vt.FloatArray),
        ((5, 3), (5, 3), np.float32, Vt.Vec3fArray),
        ((5, 4, 3), (20, 3), np.float32, Vt.Vec3fArray),
        ((5, 4), (5, 4), np.int32, Vt.Vec4iArray),
    ],
)
def test_lent_memory_is_handed_over(shape, flat, dtype, kind) -> None:
    """Oracle: the address of the numbers; whoever still has the array can only read it."""
    array = empty(shape, dtype)
    array[:] = np.random.default_rng(0).normal(0, 100, shape)
    expected, address = array.copy(), array.ctypes.data
    made = to_vt(array[:].reshape(flat), kind)
    assert np.asarray(made).ctypes.data == address
    np.testing.assert_array_equal(np.asarray(made).reshape(shape), expected)
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1
    assert to_vt(array.reshape(flat), kind) == made


@pytest.mark.parametrize(
    "part",
    [np.s_[1:], np.s_[:-1], np.s_[::-1], np.s_[::2], np.s_[[0, 1, 2, 3, 4]], np.s_[:, ::-1]],
    ids=str,
)
def test_a_part_of_lent_memory_is_copied(part) -> None:
    """Oracle: NumPy's own indexing; the lender stays as it is."""
    array = empty((5, 3))
    array[:] = np.arange(15).reshape(5, 3)
    made = to_vt(array[part], Vt.Vec3fArray)
    np.testing.assert_array_equal(np.asarray(made), array[part])
    assert not np.shares_memory(np.asarray(made), array)
    array[0] = 7


def test_lent_memory_of_another_kind_is_copied() -> None:
    """Oracle: NumPy's conversion; quaternions change order and never share memory."""
    array = empty((5, 3))
    array[:] = 0.1
    half = to_vt(array, Vt.Vec3hArray)
    np.testing.assert_array_equal(np.asarray(half), array.astype(np.float16))
    turns = empty((2, 4))
    turns[:] = [[1, 2, 3, 4], [5, 6, 7, 8]]
    assert to_vt(turns, Vt.QuatfArray)[1] == Gf.Quatf(5, 6, 7, 8)
    assert turns.flags.writeable


def test_lent_memory_lives_as_long_as_anybody_has_it() -> None:
    """Oracle: the numbers, after stage and lender are gone, and before."""
    array = empty((1000, 3))
    array[:] = np.arange(3000).reshape(1000, 3)
    stage = Usd.Stage.CreateInMemory()
    points = UsdGeom.Points.Define(stage, "/Points").CreatePointsAttr()
    points.Set(to_vt(array, Vt.Vec3fArray))
    view = array[10]
    del array
    found = np.asarray(points.Get())
    del stage, points
    for _ in range(10):
        np.full((1000, 3), -1, np.float32)  # what would take the place of freed memory
    np.testing.assert_array_equal(found, np.arange(3000).reshape(1000, 3))
    np.testing.assert_array_equal(view, [30, 31, 32])


def test_nothing_is_lent_of_nothing() -> None:
    """Oracle: the shapes."""
    for shape in ((0,), (0, 3), (0, 4, 3)):
        assert empty(shape).shape == shape
