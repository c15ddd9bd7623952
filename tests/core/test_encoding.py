"""Tests of number encodings shared by formats and the packed schema."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from usdsplat.core import encoding

QUATERNIONS = hnp.arrays(np.float64, (8, 4), elements=st.floats(-1, 1)).filter(
    lambda q: (np.linalg.norm(q, axis=1) > 1e-3).all()
)


def unit(quaternions: np.ndarray) -> np.ndarray:
    """Rows of length 1."""
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rotation angle between unit quaternions [rad], by chords so that small ones are exact."""
    chord = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    return 4 * np.arcsin(np.minimum(chord / 2, 1))


def test_sigmoid_is_the_closed_form_and_never_overflows() -> None:
    """Oracle: 1 / (1 + e^-x) in float64, its limits at the infinities, warnings as errors."""
    x = np.linspace(-30, 30, 101)
    np.testing.assert_allclose(encoding.sigmoid(x), 1 / (1 + np.exp(-x)), rtol=1e-14)
    with np.errstate(over="raise", invalid="raise"):
        ends = encoding.sigmoid(np.float32([-np.inf, -1e30, 0, 1e30, np.inf]))
    assert ends.dtype == np.float32
    assert ends.tolist() == [0, 0, 0.5, 1, 1]


def test_logit_takes_zero_and_one_to_the_infinities() -> None:
    """Oracle: ln(p / (1 - p)) and its limits, which capture files use."""
    p = np.array([1e-12, 0.25, 0.5, 0.9])
    np.testing.assert_allclose(encoding.logit(p), np.log(p / (1 - p)), rtol=1e-12, atol=1e-15)
    assert encoding.logit(np.float32([0, 1])).tolist() == [-np.inf, np.inf]
    assert encoding.logit(np.float32([0.3])).dtype == np.float32


@settings(max_examples=40, deadline=None)
@given(hnp.arrays(np.float32, 20, elements=st.floats(-15, 15, width=32)))
def test_logit_undoes_sigmoid(x: np.ndarray) -> None:
    """Oracle: round trip; near 1 float32 keeps only eps / (1 - p) of it."""
    p = encoding.sigmoid(x)
    bound = 1e-6 * np.abs(x) + 4 * np.finfo(np.float32).eps / np.maximum(1 - p, 1e-7) + 1e-6
    assert (np.abs(encoding.logit(p) - x) <= bound)[p < 1].all()


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(np.float32, (5, 3), elements=st.floats(-100, 100, width=32)),
    st.sampled_from([1, 255, 1023, 2047, 65535]),
)
def test_quantization_errs_by_half_a_step_at_most(values: np.ndarray, top: int) -> None:
    """Oracle: the definition of nearest code; both ends of the range are exact."""
    lower, upper = values.min(axis=0), values.max(axis=0)
    codes = encoding.quantize(values, lower, upper, top)
    assert codes.dtype == np.uint32 and codes.max() <= top
    back = encoding.dequantize(codes, lower, upper, top)
    step = (upper.astype(float) - lower) / top
    assert (np.abs(back - values) <= step / 2 + 1e-5).all()
    np.testing.assert_array_equal(back.min(axis=0), lower)


def test_values_outside_the_range_are_clamped_and_an_empty_range_is_code_zero() -> None:
    """Oracle: by hand."""
    values = np.float32([-5, 0, 0.49, 0.51, 1, 9, np.inf, -np.inf])
    assert encoding.quantize(values, 0, 1, 1).tolist() == [0, 0, 0, 1, 1, 1, 1, 0]
    assert encoding.quantize(np.float32([3, 3]), 3, 3, 255).tolist() == [0, 0]
    assert encoding.dequantize(np.uint8([0, 255]), 3, 3, 255).tolist() == [3, 3]


def test_an_even_top_gives_the_middle_its_own_code() -> None:
    """Oracle: (0 - -1) / 2 of 254 steps is step 127, and back to exactly 0."""
    codes = encoding.quantize(np.float32([0]), -1, 1, 254)
    assert codes.tolist() == [127]
    assert encoding.dequantize(codes, -1, 1, 254).tolist() == [0]


@settings(max_examples=50, deadline=None)
@given(QUATERNIONS, st.sampled_from([255, 1023, 32767]))
def test_smallest_three_err_by_less_than_the_documented_angle(q: np.ndarray, top: int) -> None:
    """Oracle: an error of half a step in each of three components, carried through the sphere.

    That error e lengthens to at most 2 e with the component left out, which is 1/2 or more, and a
    rotation turns twice as far as its quaternion.
    """
    q = unit(q)
    largest, codes = encoding.encode_smallest_three(q, top=top)
    back = encoding.decode_smallest_three(largest, codes, top=top)
    assert codes.max() <= top
    np.testing.assert_array_equal(largest, np.argmax(np.abs(q), axis=1))
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, atol=1e-6)
    error = np.sqrt(3) * encoding.SMALL_LIMIT / top
    assert (angle(q, back) <= 4 * error * 1.001 + 1e-6).all()


@settings(max_examples=50, deadline=None)
@given(QUATERNIONS)
def test_splitting_and_joining_keeps_the_rotation(q: np.ndarray) -> None:
    """Oracle: q and -q are one rotation; nothing else may change, even for equal components."""
    q = unit(q)
    largest, rest = encoding.split_largest(q)
    assert (np.abs(rest) <= encoding.SMALL_LIMIT + 1e-12).all()
    assert (angle(q, encoding.join_largest(largest, rest)) < 1e-6).all()


def test_known_codes_of_a_compressed_ply() -> None:
    """Oracle: the layout in words: value = (code / 1023 - 1/2) sqrt(2), order w x y z.

    For half a turn about (0.6, 0, 0.8): z is largest, then w = 0, x = 0.6, y = 0 remain.
    """
    largest, codes = encoding.encode_smallest_three(np.array([[0, -0.6, 0, -0.8]]), top=1023)
    assert largest.tolist() == [3]
    assert codes[0, 1] == round((0.6 / np.sqrt(2) + 0.5) * 1023)
    assert codes[0, 0] in (511, 512) and codes[0, 2] in (511, 512)


@pytest.mark.parametrize("index", range(4))
def test_three_components_longer_than_one_still_decode_to_a_unit_quaternion(index: int) -> None:
    """Oracle: codes no encoder writes: three times the limit has length sqrt(3/2)."""
    codes = np.full((1, 3), 1023)
    back = encoding.decode_smallest_three(np.array([index]), codes, top=1023)
    expected = np.full(4, 1 / np.sqrt(3))
    expected[index] = 0
    np.testing.assert_allclose(back[0], expected, atol=1e-6)
