"""Tests of the stock type: usdVol's rules for reading, and requirements of other readers."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from tests.schema.clouds import cloud, stock_prim, three_points
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.schema import tokens

HALF_ATTRIBUTES = {name for name in tokens.HALF_OF.values() if name != tokens.POSITIONS_HALF}


def assert_same(a: SplatCloud, b: SplatCloud) -> None:
    """Every array equal, bit for bit."""
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert (x is None) == (y is None), field.name
        if x is not None:
            np.testing.assert_array_equal(x, y, err_msg=field.name)


def test_values_that_usd_wrote_are_read(stage: Usd.Stage) -> None:
    """Oracle: numbers authored through Gf and Vt alone."""
    prim = stock_prim(
        stage,
        {
            "positions": three_points(),
            "orientations": Vt.QuatfArray(
                [Gf.Quatf(1, 0, 0, 0), Gf.Quatf(0, 1, 0, 0), Gf.Quatf(0.6, 0, 0.8, 0)]
            ),
            "scales": Vt.Vec3fArray([(1, 2, 3)] * 3),
            "opacities": Vt.FloatArray([0.25, 0.5, 1]),
            "radiance:sphericalHarmonicsDegree": 1,
            "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray(
                [(10 * i + k, 0, 1) for i in range(3) for k in range(4)]
            ),
        },
    )
    found = schema.fetch(prim)
    assert found.positions.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    expected = [[1, 0, 0, 0], [0, 1, 0, 0], [0.6, 0, 0.8, 0]]
    np.testing.assert_array_equal(found.rotations, np.float32(expected))
    assert found.scales[2].tolist() == [1, 2, 3]
    assert found.opacities.tolist() == [0.25, 0.5, 1]
    assert found.sh[2, 3].tolist() == [23, 0, 1]


def test_what_is_written_comes_back_bit_for_bit(stage: Usd.Stage) -> None:
    """Oracle: the cloud itself, through a crate file's worth of USD."""
    source = cloud(n=50, moving=True)
    prim = schema.author(stage, "/Splats", source)
    assert_same(schema.fetch(prim), source)
    assert prim.GetAttribute("orientations").Get()[3] == Gf.Quatf(*source.rotations[3].tolist())


def test_float_arrays_are_read_in_place(stage: Usd.Stage) -> None:
    """Oracle: NumPy's ownership flags, and that the arrays cannot be written."""
    found = schema.fetch(schema.author(stage, "/Splats", cloud()))
    for array in (found.positions, found.scales, found.opacities, found.sh):
        assert not array.flags.writeable


def test_missing_arrays_take_the_schemas_defaults(stage: Usd.Stage) -> None:
    """Oracle: the schema's documentation: no rotation, unit scale, opaque, grey of degree 0."""
    found = schema.fetch(stock_prim(stage, {"positions": three_points()}))
    assert found.rotations.tolist() == [[1, 0, 0, 0]] * 3
    assert found.scales.tolist() == [[1, 1, 1]] * 3
    assert found.opacities.tolist() == [1, 1, 1]
    assert found.sh.tolist() == [[[0, 0, 0]]] * 3


def test_arrays_that_are_too_short_are_ignored_as_a_whole(stage: Usd.Stage) -> None:
    """Oracle: the schema's documentation."""
    prim = stock_prim(
        stage,
        {
            "positions": three_points(),
            "scales": Vt.Vec3fArray([(5, 5, 5)] * 2),
            "opacities": Vt.FloatArray([0.5]),
            "orientations": Vt.QuatfArray([Gf.Quatf(0, 1, 0, 0)] * 2),
            "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray([(9, 9, 9)] * 47),
        },
    )
    found = schema.fetch(prim)
    assert found.scales.tolist() == [[1, 1, 1]] * 3
    assert found.opacities.tolist() == [1, 1, 1]
    assert found.rotations[0].tolist() == [1, 0, 0, 0]
    assert found.sh_degree == 0


def test_arrays_that_are_too_long_are_cut(stage: Usd.Stage) -> None:
    """Oracle: the schema's documentation."""
    prim = stock_prim(
        stage,
        {
            "positions": three_points(),
            "opacities": Vt.FloatArray([0.1, 0.2, 0.3, 0.4]),
            "radiance:sphericalHarmonicsDegree": 0,
            "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray([(i, 0, 0) for i in range(9)]),
        },
    )
    found = schema.fetch(prim)
    np.testing.assert_array_equal(found.opacities, np.float32([0.1, 0.2, 0.3]))
    assert found.sh[:, 0, 0].tolist() == [0, 1, 2]


def test_a_prim_without_a_degree_has_degree_three(stage: Usd.Stage) -> None:
    """Oracle: the schema's fallback: 16 coefficients a splat."""
    values = Vt.Vec3fArray([(i, 0, 0) for i in range(48)])
    name = "radiance:sphericalHarmonicsCoefficients"
    found = schema.fetch(stock_prim(stage, {"positions": three_points(), name: values}))
    assert found.sh[2, 0, 0] == 32


def test_a_degree_above_four_is_cut_to_four(stage: Usd.Stage) -> None:
    """Oracle: 36 coefficients a splat at degree 5, of which the first 25 are degrees 0 to 4."""
    prim = stock_prim(
        stage,
        {
            "positions": three_points(),
            "radiance:sphericalHarmonicsDegree": 5,
            "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray(
                [(i, 0, 0) for i in range(108)]
            ),
        },
    )
    found = schema.fetch(prim)
    assert found.sh_degree == 4
    assert found.sh[1, :, 0].tolist() == list(range(36, 61))


def test_a_negative_degree_is_grey(stage: Usd.Stage) -> None:
    """Oracle: no coefficient count fits, so the documented default holds."""
    prim = stock_prim(stage, {"positions": three_points(), "radiance:sphericalHarmonicsDegree": -1})
    assert schema.fetch(prim).sh.tolist() == [[[0, 0, 0]]] * 3


def test_float_wins_over_half_unless_it_is_empty(stage: Usd.Stage) -> None:
    """Oracle: the rule of usdVol's UsesFloatOpacities: has elements at the earliest time."""
    prim = stock_prim(stage, {"positions": three_points()})
    half, whole = prim.GetAttribute("opacitiesh"), prim.GetAttribute("opacities")
    half.Set(Vt.HalfArray([0.5, 0.5, 0.5]))
    assert schema.fetch(prim).opacities.tolist() == [0.5, 0.5, 0.5]
    whole.Set(Vt.FloatArray([1, 0, 1]))
    assert schema.fetch(prim).opacities.tolist() == [1, 0, 1]
    whole.Set(Vt.FloatArray())
    assert schema.fetch(prim).opacities.tolist() == [0.5, 0.5, 0.5]


def test_float_samples_win_at_times_where_they_are_empty(stage: Usd.Stage) -> None:
    """Oracle: the same rule: the earliest time decides for all, so 5 is too short, not half."""
    prim = stock_prim(stage, {"positions": three_points()})
    prim.GetAttribute("opacitiesh").Set(Vt.HalfArray([0.5] * 3))
    prim.GetAttribute("opacities").Set(Vt.FloatArray([0, 0, 0]), 1)
    prim.GetAttribute("opacities").Set(Vt.FloatArray(), 5)
    assert schema.fetch(prim, 1).opacities.tolist() == [0, 0, 0]
    assert schema.fetch(prim, 5).opacities.tolist() == [1, 1, 1]


def test_half_centres_are_read(stage: Usd.Stage) -> None:
    """Oracle: numbers that half holds exactly."""
    prim = stock_prim(stage, {"positionsh": Vt.Vec3hArray([Gf.Vec3h(1, 2, 3)])})
    found = schema.fetch(prim)
    assert found.positions.dtype == np.float32
    assert found.positions.tolist() == [[1, 2, 3]]


def test_quaternions_of_other_lengths_are_normalised(stage: Usd.Stage) -> None:
    """Oracle: Gf's GetNormalized; a zero one is no rotation."""
    raw = [Gf.Quatf(2, 0, 0, 0), Gf.Quatf(1, 2, 3, 4), Gf.Quatf(0, 0, 0, 0)]
    prim = stock_prim(stage, {"positions": three_points(), "orientations": Vt.QuatfArray(raw)})
    found = schema.fetch(prim).rotations
    unit = raw[1].GetNormalized()
    np.testing.assert_allclose(found[1], [unit.GetReal(), *unit.GetImaginary()], atol=1e-7)
    assert found[0].tolist() == [1, 0, 0, 0]
    assert found[2].tolist() == [1, 0, 0, 0]


def test_half_keeps_centres_float_and_the_rest_to_its_precision(stage: Usd.Stage) -> None:
    """Oracle: NumPy's own rounding to half, and the attributes that the schema names."""
    source = cloud(n=200)
    prim = schema.author(stage, "/Splats", source, form="half")
    found = schema.fetch(prim)
    np.testing.assert_array_equal(found.positions, source.positions)
    for name in ("scales", "opacities", "sh"):
        expected = getattr(source, name).astype(np.float16).astype(np.float32)
        np.testing.assert_array_equal(getattr(found, name), expected)
    authored = {a.GetName() for a in prim.GetAuthoredAttributes()}
    assert authored >= HALF_ATTRIBUTES | {"positions"}
    assert not authored & (set(tokens.HALF_OF) - {"positions"})
    assert tokens.POSITIONS_HALF not in authored


def test_a_tiny_scale_does_not_vanish_in_half(stage: Usd.Stage) -> None:
    """Oracle: the smallest positive half, 2^-24; zero stays zero."""
    source = replace(cloud(n=1), scales=np.float32([[1e-12, 0, 1]]))
    found = schema.fetch(schema.author(stage, "/Splats", source, form="half"))
    assert found.scales.tolist() == [[2.0**-24, 0, 1]]


@pytest.mark.parametrize("name", ["scales", "sh"])
def test_numbers_beyond_half_are_refused(stage: Usd.Stage, name: str) -> None:
    """Oracle: 65504 is the largest half; nothing is written."""
    source = cloud(n=2)
    source = replace(source, **{name: getattr(source, name) * np.float32(1e6)})
    with pytest.raises(UsageError, match="65504"):
        schema.author(stage, "/Splats", source, form="half")
    assert not stage.GetPrimAtPath("/Splats")


@pytest.mark.parametrize("form", ["float", "half"])
def test_coefficients_carry_what_others_validate(stage: Usd.Stage, form: str) -> None:
    """Oracle: the rules of NVIDIA's VG.035: element size (degree + 1)^2, one set a vertex."""
    prim = schema.author(stage, "/Splats", cloud(degree=2), form=form)
    name = tokens.SH_COEFFICIENTS if form == "float" else tokens.SH_COEFFICIENTS_HALF
    primvar = UsdGeom.Primvar(prim.GetAttribute(name))
    assert primvar.GetElementSize() == 9
    assert primvar.GetInterpolation() == "vertex"
    assert prim.GetAttribute(tokens.SH_DEGREE).Get() == 2


def test_usd_interpolates_stock_samples(stage: Usd.Stage) -> None:
    """Oracle: half way by hand; a half turn about x is half done at 90 degrees."""
    first, last = cloud(1, n=1), cloud(2, n=1)
    first = replace(first, rotations=np.float32([[1, 0, 0, 0]]))
    last = replace(last, rotations=np.float32([[0, 1, 0, 0]]))
    prim = schema.author(stage, "/Splats", first, time=1)
    schema.author(stage, "/Splats", last, time=3)
    found = schema.fetch(prim, 2)
    np.testing.assert_allclose(found.scales, (first.scales + last.scales) / 2, rtol=1e-6)
    np.testing.assert_allclose(found.sh, (first.sh + last.sh) / 2, atol=1e-6)
    np.testing.assert_allclose(found.rotations, [[0.5**0.5, 0.5**0.5, 0, 0]], atol=1e-6)


def test_splats_that_change_rows_are_held_between_samples(stage: Usd.Stage) -> None:
    """Oracle: the earlier sample, since row i is another splat in the next one."""
    first = replace(cloud(1, n=5, moving=True), velocities=None)
    last = replace(cloud(2, n=5), ids=first.ids[::-1].copy())
    prim = schema.author(stage, "/Splats", first, time=1)
    schema.author(stage, "/Splats", last, time=3)
    assert_same(schema.fetch(prim, 2.9), first)
    assert_same(schema.fetch(prim, 3), last)


def test_a_stage_that_holds_values_is_obeyed(stage: Usd.Stage) -> None:
    """Oracle: USD's held interpolation is the earlier sample."""
    first, last = cloud(1, n=5), cloud(2, n=5)
    prim = schema.author(stage, "/Splats", first, time=1)
    schema.author(stage, "/Splats", last, time=3)
    stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    assert_same(schema.fetch(prim, 2), first)


@pytest.mark.parametrize("form", ["float", "half"])
def test_a_field_may_grow_from_nothing(stage: Usd.Stage, form: str) -> None:
    """Oracle: the clouds that were written; USD holds the first one, of another length, between."""
    grown = cloud(n=7)
    prim = schema.author(stage, "/Splats", cloud(n=0), form=form, time=1)
    schema.author(stage, "/Splats", grown, form=form, time=2)
    assert schema.form_of(prim) == form
    assert [len(schema.fetch(prim, time)) for time in (1, 1.5, 2)] == [0, 0, 7]
    dtype = np.float32 if form == "float" else np.float16
    found = schema.fetch(prim, 2)
    np.testing.assert_array_equal(found.positions, grown.positions)
    np.testing.assert_array_equal(found.opacities, grown.opacities.astype(dtype))
    np.testing.assert_array_equal(found.sh, grown.sh.astype(dtype))


@pytest.mark.parametrize("form", ["float", "half", "packed"])
@pytest.mark.parametrize("time", [1, 1.5, 2])
def test_every_array_lies_row_after_row(stage: Usd.Stage, form: str, time: float) -> None:
    """Oracle: NumPy's own flags; kernels would copy anything else at every frame."""
    moving = cloud(1, n=20, moving=True)
    prim = schema.author(stage, "/Splats", moving, form=form, time=1)
    after = replace(cloud(2, n=20), ids=moving.ids, velocities=moving.velocities)
    schema.author(stage, "/Splats", after, form=form, time=2)
    found = schema.fetch(prim, time)
    scattered = [f.name for f in fields(found) if not getattr(found, f.name).flags.c_contiguous]
    assert scattered == []


def test_harmonics_that_are_cut_lie_row_after_row(stage: Usd.Stage) -> None:
    """Oracle: NumPy's own flags, for the first 25 of 36 coefficients a splat."""
    prim = stock_prim(
        stage,
        {
            "positions": three_points(),
            "radiance:sphericalHarmonicsDegree": 5,
            "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray(108),
        },
    )
    assert schema.fetch(prim).sh.flags.c_contiguous
