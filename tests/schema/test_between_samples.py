"""Tests of fields at times between their samples, as needed for motion blur."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from tests.schema.clouds import angles, cloud
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.schema import tokens

FORMS = ("float", "half", "packed")
TIMES = (0.0, 1.0, 1.25, 2.75, 3.0, 4.5)


def points(stage: Usd.Stage, path: str, samples: dict[float, SplatCloud]) -> UsdGeom.Points:
    """The same centres and velocities on a prim whose motion USD itself works out."""
    prim = UsdGeom.Points.Define(stage, path)
    for time, each in samples.items():
        prim.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(each.positions), time)
        prim.CreateVelocitiesAttr().Set(Vt.Vec3fArray.FromNumpy(each.velocities), time)
    return prim


def moved(prim: UsdGeom.Points, time: float) -> np.ndarray:
    """Where USD says the points are."""
    return np.asarray(prim.ComputePointsAtTime(Usd.TimeCode(time), Usd.TimeCode(time)))


@pytest.mark.parametrize("form", FORMS)
def test_velocities_move_splats_as_usd_moves_points(stage: Usd.Stage, form: str) -> None:
    """Oracle: UsdGeom.Points with the same arrays; the samples hold other numbers of splats, so
    that some are born and others die."""
    stage.SetTimeCodesPerSecond(24)
    samples = {1: cloud(1, n=6, moving=True), 3: cloud(2, n=4, moving=True)}
    for time, each in samples.items():
        prim = schema.author(stage, "/Splats", each, form=form, time=time)
    oracle = points(stage, "/Points", samples)
    for time in TIMES:
        found = schema.fetch(prim, time)
        np.testing.assert_allclose(found.positions, moved(oracle, time), atol=1e-6)
        before = samples[1 if time < 3 else 3]
        np.testing.assert_array_equal(found.velocities, before.velocities)
        np.testing.assert_array_equal(found.ids, before.ids)
        held = schema.fetch(prim, 1 if time < 3 else 3)
        np.testing.assert_array_equal(found.scales, held.scales)


def test_a_second_is_as_many_time_codes_as_the_stage_says(stage: Usd.Stage) -> None:
    """Oracle: the closed form x + v (t - t0) / rate, from one sample both ways."""
    stage.SetTimeCodesPerSecond(50)
    source = cloud(n=3, moving=True)
    prim = schema.author(stage, "/Splats", source, time=10)
    for time in (0, 9.75, 10, 12.5):
        expected = source.positions + source.velocities * (time - 10) / 50
        np.testing.assert_allclose(schema.fetch(prim, time).positions, expected, atol=1e-6)


@pytest.mark.parametrize(("at", "count"), [((1, 2), 5), ((1, 3), 4), ((1, 3), 6), ((), 5)], ids=str)
def test_velocities_of_other_times_or_numbers_move_nothing(
    stage: Usd.Stage, at: tuple[float, ...], count: int
) -> None:
    """Oracle: UsdGeom.Points ignores them and interpolates, as half way by hand; () is a default
    value."""
    first, last = cloud(1, n=5), cloud(2, n=5)
    prim = schema.author(stage, "/Splats", first, time=1)
    schema.author(stage, "/Splats", last, time=3)
    attribute = prim.GetAttribute(tokens.VELOCITIES)
    for time in at or (Usd.TimeCode.Default(),):
        attribute.Set(Vt.Vec3fArray(count, (1, 1, 1)), time)
    expected = 0.5 * first.positions + 0.5 * last.positions
    if at == (1, 2):
        expected = 0.25 * first.positions + 0.75 * last.positions
    found = schema.fetch(prim, 2.5 if at == (1, 2) else 2)
    np.testing.assert_allclose(found.positions, expected, atol=1e-6)


def test_on_a_sample_nothing_is_computed(stage: Usd.Stage) -> None:
    """Oracle: the memory of USD's own array."""
    source = cloud(n=300, moving=True)
    prim = schema.author(stage, "/Splats", source, time=1)
    schema.author(stage, "/Splats", source, time=2)
    held = np.asarray(prim.GetAttribute("positions").Get(2))
    assert np.shares_memory(schema.fetch(prim, 2).positions, held)


@pytest.mark.parametrize("form", ["half", "packed"])
@pytest.mark.parametrize("time", TIMES)
def test_every_form_is_interpolated_like_float(stage: Usd.Stage, form: str, time: float) -> None:
    """Oracle: USD's interpolation of what the samples decode to, on a float prim; half rounds."""
    first, last = cloud(1, n=50, moving=True), cloud(2, n=50)
    first, last = replace(first, velocities=None), replace(last, ids=first.ids)
    prim = schema.author(stage, "/Splats", first, form=form, time=1)
    schema.author(stage, "/Splats", last, form=form, time=3)
    plain = schema.author(stage, "/Float", schema.fetch(prim, 1), time=1)
    schema.author(stage, "/Float", schema.fetch(prim, 3), time=3)
    found, expected = schema.fetch(prim, time), schema.fetch(plain, time)
    rtol = 2e-3 if form == "half" else 1e-5
    for name in ("positions", "scales", "opacities", "sh"):
        actual, wanted = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(actual, wanted, rtol=rtol, atol=rtol, err_msg=name)
    assert angles(found.rotations, expected.rotations).max() < 2 * rtol


@pytest.mark.parametrize("form", FORMS)
def test_splats_that_change_rows_still_move(stage: Usd.Stage, form: str) -> None:
    """Oracle: the closed form for the centres, the earlier sample for all else."""
    stage.SetTimeCodesPerSecond(24)
    first, last = cloud(1, n=5, moving=True), cloud(2, n=5, moving=True)
    last = replace(last, ids=first.ids[::-1].copy())
    prim = schema.author(stage, "/Splats", first, form=form, time=1)
    schema.author(stage, "/Splats", last, form=form, time=2)
    found, held = schema.fetch(prim, 1.5), schema.fetch(prim, 1)
    expected = first.positions + first.velocities / 48
    np.testing.assert_allclose(found.positions, expected, atol=1e-6)
    for name in ("scales", "rotations", "opacities", "sh", "ids"):
        np.testing.assert_array_equal(getattr(found, name), getattr(held, name))


def test_one_sample_with_velocities_varies_and_one_without_does_not(stage: Usd.Stage) -> None:
    """Oracle: the clouds at two times."""
    still = schema.author(stage, "/Still", cloud(n=3), time=1)
    moving = schema.author(stage, "/Moving", cloud(n=3, moving=True), time=1)
    scan = schema.author(stage, "/Scan", cloud(n=3, moving=True))
    for prim, varies in ((still, False), (moving, True), (scan, False)):
        here, there = (schema.fetch(prim, time).positions for time in (1, 5))
        assert schema.is_time_varying(prim) == varies == (not np.array_equal(here, there))
