"""Tests of the packed layout: its bits, and all error bounds of the schema."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.schema.clouds import angles, cloud
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.sh import C0
from usdsplat.schema import packing

SEEDS = st.integers(0, 2**32 - 1)
PROPERTY = settings(max_examples=40, deadline=None)


def decoded(source: SplatCloud) -> SplatCloud:
    """There and back."""
    return packing.unpack(source.positions, packing.pack(source))


def one(**values: object) -> SplatCloud:
    """A single splat, grey and round unless told otherwise."""
    standard = {
        "positions": np.zeros((1, 3), np.float32),
        "scales": np.ones((1, 3), np.float32),
        "rotations": np.float32([[1, 0, 0, 0]]),
        "opacities": np.ones(1, np.float32),
        "sh": np.zeros((1, 1, 3), np.float32),
    }
    return SplatCloud(**{**standard, **values})


def test_the_bits_of_a_record_are_where_the_layout_says() -> None:
    """Oracle: codes worked out by hand from the module's docstring.

    Scales 1, 2, 1/2 have the codes 32768, 33792, 31744. A half turn about an axis between x and y
    leaves out x (index 1): its others are w = 0, y = sqrt(1/2), z = 0. Opacity 1 is 511.
    """
    half = math.sqrt(0.5)
    source = one(
        scales=np.float32([[1, 2, 0.5]]), rotations=np.float32([[0, half * 1.0001, half, 0]])
    )
    x, y, z, w = packing.pack(source).core.view(np.uint32)[0].tolist()
    assert (x & 0xFFFF, x >> 16) == (32768, 33792)
    assert (y & 0xFFFF, y >> 16 & 0x7FFF, y >> 31) == (31744, 16383, 1)
    assert (z & 0x7FFF, z >> 15 & 0x7FFF, z >> 30) == (32765, 16383, 1)
    assert w >> 24 == 255


def test_colour_bytes_are_red_green_blue_over_the_range_of_each_channel() -> None:
    """Oracle: the ends of a range have the codes 0 and 255, by the layout."""
    sh = np.zeros((2, 1, 3), np.float32)
    sh[0, 0], sh[1, 0] = (0, 5, -1), (1, 2, -1)
    arrays = packing.pack(replace(cloud(n=2, degree=0), sh=sh))
    assert (arrays.core.view(np.uint32)[:, 3] & 0xFFFFFF).tolist() == [0x00FF00, 0x0000FF]
    expected = 0.5 + C0 * np.array([[0, 2, -1], [1, 5, -1]])
    np.testing.assert_allclose(arrays.color_range, expected, rtol=1e-6)


def test_harmonics_are_signed_bytes_coefficient_by_coefficient() -> None:
    """Oracle: the layout; the largest of a degree has the code 127, minus half of it -64."""
    sh = np.zeros((1, 9, 3), np.float32)
    sh[0, 1], sh[0, 4] = (4, -2, 0), (0, 0, -0.5)
    arrays = packing.pack(one(sh=sh))
    codes = arrays.harmonics.view(np.int8).ravel()
    assert codes[:4].tolist() == [127, -64, 0, 0]
    assert codes[9:13].tolist() == [0, 0, -127, 0]
    assert not codes[24:].any()
    assert arrays.harmonics_range.tolist() == [4, 0.5]


@pytest.mark.parametrize(("degree", "width"), [(0, 0), (1, 1), (2, 2), (3, 3), (4, 5)])
def test_a_splat_takes_16_bytes_and_padded_harmonics(degree: int, width: int) -> None:
    """Oracle: 3 ((degree + 1)^2 - 1) bytes rounded up to 16, by hand."""
    arrays = packing.pack(cloud(n=7, degree=degree))
    assert arrays.core.shape == (7, 4)
    assert arrays.harmonics.shape == (7 * width, 4)


@PROPERTY
@given(SEEDS)
def test_rotations_stay_within_a_hundredth_of_a_degree(seed: int) -> None:
    """Oracle: the angle between quaternions, in float64."""
    source = cloud(seed, n=2000, degree=0)
    assert angles(source.rotations, decoded(source).rotations).max() <= math.radians(0.01)


def test_the_hardest_rotations_stay_within_the_bound() -> None:
    """Oracle: as above, near equal components, where the left-out one is worst conditioned."""
    rng = np.random.default_rng(1)
    near = np.float32(0.5) * rng.choice([-1, 1], (50_000, 4)) + rng.normal(0, 1e-3, (50_000, 4))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    source = replace(cloud(n=50_000, degree=0), rotations=near.astype(np.float32))
    errors = angles(source.rotations, decoded(source).rotations)
    assert math.radians(0.008) < errors.max() <= math.radians(0.01)


@PROPERTY
@given(SEEDS, st.floats(-31.9, 31.9))
def test_scales_stay_within_their_relative_bound(seed: int, octave: float) -> None:
    """Oracle: 2^(1/2048) - 1, half a step of 1024 in an octave."""
    rng = np.random.default_rng(seed)
    scales = np.exp2(np.clip(rng.normal(octave, 1, (500, 3)), -31.9, 31.9)).astype(np.float32)
    found = decoded(replace(cloud(n=500, degree=0), scales=scales)).scales
    relative = np.abs(found.astype(np.float64) / scales - 1)
    assert relative.max() <= 2 ** (1 / 2048) - 1 + 1e-7


def test_zero_scales_stay_zero_and_others_stay_positive() -> None:
    """Oracle: the layout: code 0 is zero, and only that."""
    scales = np.float32([[0, 1e-30, 1e30]])
    found = decoded(one(scales=scales)).scales[0]
    assert found[0] == 0
    assert 0 < found[1] < 2**-31
    assert found[2] > 2**31


@PROPERTY
@given(SEEDS, st.floats(0, 1000))
def test_opacities_and_colours_stay_within_their_bounds(seed: int, brightest: float) -> None:
    """Oracle: half a step of 511, and of 255 over the range that the colours span."""
    source = cloud(seed, n=500, degree=0)
    source = replace(source, sh=source.sh + np.float32(brightest) * (source.sh > 2))
    found = decoded(source)
    assert np.abs(found.opacities - source.opacities).max() <= 1 / 1022 + 1e-7
    colors = 0.5 + C0 * source.sh[:, 0].astype(np.float64)
    span = np.ptp(colors, axis=0)
    error = np.abs(0.5 + C0 * found.sh[:, 0].astype(np.float64) - colors)
    assert (error <= span / 510 + 1e-6 * np.abs(colors).max()).all()


def test_bright_colours_keep_their_range() -> None:
    """Oracle: the ends of the range are codes of their own, so the brightest is exact."""
    sh = np.float32([[[0, 0, 0]], [[1000, 400, 3]]])
    found = decoded(replace(cloud(n=2, degree=0), sh=sh)).sh
    np.testing.assert_allclose(found, sh, rtol=1e-6, atol=1e-4)


@PROPERTY
@given(SEEDS, st.integers(1, 4))
def test_harmonics_stay_within_the_bound_of_their_degree(seed: int, degree: int) -> None:
    """Oracle: half a step of 127 in the largest magnitude of each degree, and exact zeros."""
    source = cloud(seed, n=300, degree=degree)
    sh = source.sh * np.float32(np.random.default_rng(seed).choice([0, 0.1, 7], sh_shape(degree)))
    found = decoded(replace(source, sh=sh)).sh
    for band in range(1, degree + 1):
        columns = slice(band**2, (band + 1) ** 2)
        peak = np.abs(sh[:, columns]).max()
        assert np.abs(found[:, columns] - sh[:, columns]).max() <= peak / 254 * (1 + 1e-5)
    assert not found[:, 1:][sh[:, 1:] == 0].any()


def sh_shape(degree: int) -> tuple[int, int, int]:
    """One number for each coefficient, shared by all splats and channels."""
    return 1, (degree + 1) ** 2, 1


def test_the_identity_full_and_no_opacity_are_exact() -> None:
    """Oracle: the layout gives each of them a code."""
    source = replace(
        cloud(n=2, degree=0),
        rotations=np.float32([[1, 0, 0, 0], [0, 0, -1, 0]]),
        opacities=np.float32([0, 1]),
    )
    found = decoded(source)
    assert found.rotations.tolist() == [[1, 0, 0, 0], [0, 0, 1, 0]]
    assert found.opacities.tolist() == [0, 1]


def test_decoded_rotations_have_length_one() -> None:
    """Oracle: the definition of a unit quaternion."""
    found = decoded(cloud(n=5000, degree=0)).rotations.astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)


def test_quaternions_of_any_length_are_packed_as_rotations() -> None:
    """Oracle: the same quaternions at length 1; a zero one is no rotation."""
    source = cloud(n=50, degree=0)
    longer = replace(source, rotations=source.rotations * np.float32(37))
    np.testing.assert_array_equal(packing.pack(source).core, packing.pack(longer).core)
    zero = decoded(one(rotations=np.zeros((1, 4), np.float32)))
    assert zero.rotations.tolist() == [[1, 0, 0, 0]]


def test_rows_beyond_one_chunk_are_packed_alike() -> None:
    """Oracle: the same splats packed in two clouds of one range."""
    source = cloud(n=40_000, degree=1)
    whole = decoded(source)
    one_chunk = replace(
        cloud(n=3, degree=1), scales=source.scales[-3:], rotations=source.rotations[-3:]
    )
    np.testing.assert_array_equal(decoded(one_chunk).scales, whole.scales[-3:])
    np.testing.assert_array_equal(decoded(one_chunk).rotations, whole.rotations[-3:])
    assert np.abs(whole.sh - source.sh).max() < 0.03


@pytest.mark.parametrize("name", ["scales", "rotations", "opacities", "sh"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(name: str, bad: float) -> None:
    """Oracle: the documented error, which names the array."""
    source = cloud(n=3)
    values = getattr(source, name).copy()
    values.flat[-1] = bad
    with pytest.raises(UsageError, match=name):
        packing.pack(replace(source, **{name: values}))


def test_no_splats_pack_to_nothing() -> None:
    """Oracle: shapes by definition."""
    found = decoded(cloud(n=0, degree=2))
    assert len(found) == 0
    assert found.sh_degree == 2
