"""Tests of our packed type on a stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdVol, Vt

from tests.schema.clouds import angles, cloud
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.schema import packing, tokens


def test_usd_knows_the_type_and_its_fallbacks(stage: Usd.Stage) -> None:
    """Oracle: USD's schema registry."""
    prim = stage.DefinePrim("/Splats", tokens.PACKED_TYPE)
    assert prim.IsA(UsdVol.ParticleField)
    assert prim.IsA(UsdGeom.Gprim)
    assert not prim.IsA(UsdVol.ParticleField3DGaussianSplat)
    assert prim.GetAttribute("splat:packing").Get() == packing.TOKEN
    assert prim.GetAttribute("splat:packed").GetTypeName() == "int4[]"
    assert prim.HasAPI(tokens.FIELD_API)
    assert prim.GetAttribute("splat:rasterizeMode").Get() == "classic"


def test_the_documentation_of_the_type_gives_the_bounds(stage: Usd.Stage) -> None:
    """Oracle: the numbers that test_packing proves, as USD hands out the documentation."""
    prim = stage.DefinePrim("/Splats", tokens.PACKED_TYPE)
    text = prim.GetPrimDefinition().GetDocumentation()
    for bound in ("0.01 degrees", "0.034 %", "1/1022", "/ 510", "/ 254"):
        assert bound in text


def test_a_million_splats_would_take_28_and_76_bytes_each(stage: Usd.Stage) -> None:
    """Oracle: bytes of the arrays, per splat, as the design asks."""
    for degree, expected in ((0, 28), (3, 76)):
        prim = schema.author(stage, f"/Splats{degree}", cloud(n=10, degree=degree), form="packed")
        names = (tokens.POSITIONS, tokens.PACKED, tokens.PACKED_HARMONICS)
        total = sum(np.asarray(prim.GetAttribute(name).Get()).nbytes for name in names)
        assert total == 10 * expected


def test_what_is_written_comes_back_within_the_bounds(stage: Usd.Stage) -> None:
    """Oracle: the bounds of the layout; centres, ids and velocities are exact."""
    source = cloud(n=500, moving=True)
    found = schema.fetch(schema.author(stage, "/Splats", source, form="packed"))
    for name in ("positions", "ids", "velocities"):
        np.testing.assert_array_equal(getattr(found, name), getattr(source, name))
    assert angles(source.rotations, found.rotations).max() < packing.ROTATION_ERROR
    np.testing.assert_allclose(found.scales, source.scales, rtol=packing.SCALE_ERROR * 1.001)
    assert np.abs(found.opacities - source.opacities).max() <= 1.001 / 1022
    assert np.abs(found.sh - source.sh).max() < np.ptp(source.sh) / 200


def test_a_crate_file_gives_the_same_cloud(stage: Usd.Stage, tmp_path: Path) -> None:
    """Oracle: the stage in memory."""
    source = cloud(n=300, moving=True)
    before = schema.fetch(schema.author(stage, "/Splats", source, form="packed"))
    stage.Export(str(tmp_path / "splats.usdc"))
    opened = Usd.Stage.Open(str(tmp_path / "splats.usdc"))
    after = schema.fetch(opened.GetPrimAtPath("/Splats"))
    for name in ("positions", "scales", "rotations", "opacities", "sh", "ids", "velocities"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_between_samples_decoded_splats_are_interpolated(stage: Usd.Stage) -> None:
    """Oracle: what USD itself makes of the same decoded samples on a stock prim."""
    first, last = cloud(1, n=60), cloud(2, n=60)
    packed = schema.author(stage, "/Packed", first, form="packed", time=1)
    schema.author(stage, "/Packed", last, form="packed", time=5)
    stock = schema.author(stage, "/Stock", schema.fetch(packed, 1), time=1)
    schema.author(stage, "/Stock", schema.fetch(packed, 5), time=5)
    for time in (0, 1, 2.25, 4, 5, 6):
        found, expected = schema.fetch(packed, time), schema.fetch(stock, time)
        for name in ("positions", "scales", "opacities", "sh"):
            actual, wanted = getattr(found, name), getattr(expected, name)
            np.testing.assert_allclose(actual, wanted, atol=1e-5, err_msg=f"{name} at {time}")
        assert angles(found.rotations, expected.rotations).max() < 1e-3


def test_samples_of_different_counts_are_held(stage: Usd.Stage) -> None:
    """Oracle: the earlier sample, as USD holds arrays of different lengths."""
    prim = schema.author(stage, "/Splats", cloud(1, n=5), form="packed", time=1)
    schema.author(stage, "/Splats", cloud(2, n=6), form="packed", time=2)
    np.testing.assert_array_equal(schema.fetch(prim, 1.9).sh, schema.fetch(prim, 1).sh)
    np.testing.assert_array_equal(schema.fetch(prim, 1.9).positions, cloud(1, n=5).positions)
    assert len(schema.fetch(prim, 2)) == 6


def test_a_stage_that_holds_values_is_obeyed(stage: Usd.Stage) -> None:
    """Oracle: the earlier sample."""
    prim = schema.author(stage, "/Splats", cloud(1, n=5), form="packed", time=1)
    schema.author(stage, "/Splats", cloud(2, n=5), form="packed", time=2)
    stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    for name in ("positions", "scales", "sh"):
        found, expected = schema.fetch(prim, 1.5), schema.fetch(prim, 1)
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_splats_that_change_rows_are_held_between_samples(stage: Usd.Stage) -> None:
    """Oracle: the earlier sample, centres included."""
    first = replace(cloud(1, n=5, moving=True), velocities=None)
    last = replace(cloud(2, n=5), ids=first.ids[::-1].copy())
    prim = schema.author(stage, "/Splats", first, form="packed", time=1)
    schema.author(stage, "/Splats", last, form="packed", time=2)
    found = schema.fetch(prim, 1.5)
    np.testing.assert_array_equal(found.positions, first.positions)
    np.testing.assert_array_equal(found.scales, schema.fetch(prim, 1).scales)


def test_the_ranges_belong_to_their_sample(stage: Usd.Stage) -> None:
    """Oracle: colours of 0 and of 100 a frame apart: a range that was mixed would show."""
    dark = replace(cloud(1, n=4, degree=0), sh=np.zeros((4, 1, 3), np.float32))
    bright = replace(dark, sh=np.full((4, 1, 3), 100, np.float32))
    prim = schema.author(stage, "/Splats", dark, form="packed", time=1)
    schema.author(stage, "/Splats", bright, form="packed", time=2)
    for time, expected in ((1, 0), (1.25, 25), (2, 100)):
        np.testing.assert_allclose(schema.fetch(prim, time).sh, expected, atol=1e-4)


def test_an_unknown_layout_is_refused(stage: Usd.Stage) -> None:
    """Oracle: the documented error, which names the token."""
    prim = schema.author(stage, "/Splats", cloud(n=3), form="packed")
    prim.GetAttribute(tokens.PACKING).Set("fromTheFuture_v9")
    with pytest.raises(StageError, match="fromTheFuture_v9"):
        schema.fetch(prim)


@pytest.mark.parametrize("name", tokens.PACKED_ARRAYS)
def test_arrays_that_are_missing_or_too_short_are_refused(stage: Usd.Stage, name: str) -> None:
    """Oracle: the documented error, which names the attribute."""
    prim = schema.author(stage, "/Splats", cloud(n=3), form="packed")
    attribute = prim.GetAttribute(name)
    attribute.Set(type(attribute.Get())(1))
    with pytest.raises(StageError, match=f"{name}: found 1 values"):
        schema.fetch(prim)
    attribute.Clear()
    with pytest.raises(StageError, match=f"{name}: found 0 values"):
        schema.fetch(prim)


@pytest.mark.parametrize("name", [tokens.COLOR_RANGE, tokens.HARMONICS_RANGE])
def test_ranges_that_are_not_finite_are_refused(stage: Usd.Stage, name: str) -> None:
    """Oracle: the documented error, and no warning of NumPy's."""
    prim = schema.author(stage, "/Splats", cloud(n=3), form="packed")
    value = np.array(prim.GetAttribute(name).Get())
    value.flat[0] = np.inf
    prim.GetAttribute(name).Set(type(prim.GetAttribute(name).Get()).FromNumpy(value))
    with pytest.raises(StageError, match="not finite"):
        schema.fetch(prim)


def test_a_degree_that_cannot_be_is_refused(stage: Usd.Stage) -> None:
    """Oracle: the documented error."""
    prim = schema.author(stage, "/Splats", cloud(n=3), form="packed")
    prim.GetAttribute(tokens.SH_DEGREE).Set(7)
    with pytest.raises(StageError, match="found 7, expected 0 to 4"):
        schema.fetch(prim)


def test_a_prim_without_centres_holds_no_splats(stage: Usd.Stage) -> None:
    """Oracle: centres say how many there are."""
    assert len(schema.fetch(stage.DefinePrim("/Splats", tokens.PACKED_TYPE))) == 0
    empty = schema.author(stage, "/Empty", cloud(n=0, degree=1), form="packed")
    assert len(schema.fetch(empty)) == 0


def test_centres_that_are_fewer_cut_the_rest(stage: Usd.Stage) -> None:
    """Oracle: the stock rule for arrays that are too long."""
    source = cloud(n=5)
    prim = schema.author(stage, "/Splats", source, form="packed")
    whole = schema.fetch(prim)
    prim.GetAttribute(tokens.POSITIONS).Set(Vt.Vec3fArray.FromNumpy(source.positions[:2]))
    np.testing.assert_array_equal(schema.fetch(prim).sh, whole.sh[:2])


def test_nothing_is_written_when_numbers_cannot_be_packed(stage: Usd.Stage) -> None:
    """Oracle: the stage afterwards."""
    source = cloud(n=2)
    source.opacities[0] = np.nan
    with pytest.raises(UsageError, match="opacities"):
        schema.author(stage, "/Splats", source, form="packed")
    assert not stage.GetPrimAtPath("/Splats")


def test_samples_of_different_degrees_are_held(stage: Usd.Stage) -> None:
    """Oracle: the earlier sample; the later one is another prim's, copied value by value."""
    prim = schema.author(stage, "/Splats", cloud(1, n=5, degree=1), form="packed", time=1)
    other = schema.author(stage, "/Other", cloud(2, n=5, degree=2), form="packed", time=2)
    prim.GetAttribute(tokens.SH_DEGREE).Set(1, 1)
    prim.GetAttribute(tokens.SH_DEGREE).Set(2, 2)
    for name in (tokens.POSITIONS, *tokens.PACKED_ARRAYS):
        prim.GetAttribute(name).Set(other.GetAttribute(name).Get(2), 2)
    found, expected = schema.fetch(prim, 1.5), schema.fetch(prim, 1)
    for name in ("scales", "rotations", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(schema.fetch(prim, 2).sh, schema.fetch(other, 2).sh)


def test_a_packed_prim_is_read_without_decoding_it(stage: Usd.Stage) -> None:
    """Oracle: `fetch`, which decodes; between two samples there is nothing that is packed."""
    prim = schema.author(stage, "/Splats", cloud(2), form="packed", time=1)
    schema.author(stage, "/Splats", cloud(2), form="packed", time=3)
    found = schema.fetch_packed(prim, 1)
    decoded = schema.fetch(prim, 1)
    again = packing.unpack(decoded.positions, found)
    for name in ("scales", "rotations", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(again, name), getattr(decoded, name))
    assert schema.fetch_packed(prim, 2) is None
