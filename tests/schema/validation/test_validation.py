"""Tests that every fault has a finding with a cure, and that a valid stage has none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.schema.clouds import cloud, stock_prim, three_points
from usdsplat import schema
from usdsplat.schema import Finding, tokens, validate

Fault = Callable[[Usd.Prim], None]


def found(stage: Usd.Stage, **options: float) -> dict[str, Finding]:
    """Findings by name."""
    findings = validate(stage, **options)
    names = [finding.code for finding in findings]
    assert len(set(names)) == len(names), names
    return dict(zip(names, findings, strict=True))


def setting(name: str, change: Callable[[np.ndarray], None]) -> Fault:
    """A fault that changes the numbers of a float array in place."""

    def spoil(prim: Usd.Prim) -> None:
        attribute = prim.GetAttribute(name)
        value = attribute.Get()
        array = np.array(value)
        change(array)
        attribute.Set(type(value).FromNumpy(array))

    return spoil


def cut(name: str, count: int) -> Fault:
    """A fault that leaves `count` values."""
    return lambda prim: prim.GetAttribute(name).Set(prim.GetAttribute(name).Get()[:count])


def longer(name: str) -> Fault:
    """A fault that appends a copy of the first value."""

    def spoil(prim: Usd.Prim) -> None:
        value = prim.GetAttribute(name).Get()
        prim.GetAttribute(name).Set(type(value)([*value, value[0]]))

    return spoil


def put(row: int, value: object) -> Callable[[np.ndarray], None]:
    """Set one row of an array."""

    def change(array: np.ndarray) -> None:
        array[row] = value

    return change


def scale(factor: float) -> Callable[[np.ndarray], None]:
    """Multiply an array."""

    def change(array: np.ndarray) -> None:
        array *= factor

    return change


def move(name: str, value: object) -> Fault:
    """Set an attribute."""
    return lambda prim: prim.GetAttribute(name).Set(value)


def clear(name: str) -> Fault:
    """Take an attribute's value away."""
    return lambda prim: prim.RemoveProperty(name)


SH = tokens.SH_COEFFICIENTS

STOCK_FAULTS: list[tuple[str, str, str, Fault]] = [
    ("no-splats", "warning", "positions", clear("positions")),
    ("missing", "warning", "scales", clear("scales")),
    ("missing", "warning", "orientations", clear("orientations")),
    ("missing", "warning", "opacities", clear("opacities")),
    ("missing", "warning", SH, clear(SH)),
    ("too-short", "error", "scales", cut("scales", 3)),
    ("too-short", "error", "ids", cut("ids", 3)),
    ("too-short", "error", "velocities", cut("velocities", 3)),
    ("too-long", "warning", "opacities", longer("opacities")),
    ("coefficient-count", "error", SH, cut(SH, 100)),
    ("coefficient-count", "warning", SH, longer(SH)),
    ("not-finite", "error", "positions", setting("positions", put(2, np.nan))),
    ("not-finite", "error", SH, setting(SH, put(2, np.inf))),
    ("not-finite", "error", "velocities", setting("velocities", put(2, -np.inf))),
    ("negative-scale", "error", "scales", setting("scales", put(1, (1, -1e-3, 1e-3)))),
    ("zero-scale", "warning", "scales", setting("scales", put(1, (0, 1e-3, 1e-3)))),
    ("not-unit", "error", "orientations", setting("orientations", scale(1.01))),
    ("opacity-range", "error", "opacities", setting("opacities", put(0, 1.5))),
    ("opacity-range", "error", "opacities", setting("opacities", put(0, -0.1))),
    ("repeated-ids", "error", "ids", setting("ids", put(0, 3))),
    ("no-extent", "error", "extent", clear("extent")),
    ("extent-size", "error", "extent", cut("extent", 1)),
    ("extent-too-small", "error", "extent", setting("extent", scale(0.3))),
    ("extent-too-small", "warning", "extent", setting("extent", scale(0.97))),
    ("degree", "error", tokens.SH_DEGREE, move(tokens.SH_DEGREE, -1)),
    ("no-color-space", "warning", "colorSpace:name", clear("colorSpace:name")),
    ("unknown-color-space", "error", "colorSpace:name", move("colorSpace:name", "house")),
    (
        "unknown-color-space",
        "warning",
        "colorSpace:name",
        move("colorSpace:name", "srgb_rec709_display"),
    ),
    (
        "element-size",
        "warning",
        SH,
        lambda p: UsdGeom.Primvar(p.GetAttribute(SH)).SetElementSize(3),
    ),
    (
        "interpolation",
        "warning",
        SH,
        lambda p: UsdGeom.Primvar(p.GetAttribute(SH)).SetInterpolation("constant"),
    ),
]

PACKED_FAULTS: list[tuple[str, str, str, Fault]] = [
    ("unknown-packing", "error", tokens.PACKING, move(tokens.PACKING, "other_v1")),
    ("packed-count", "error", tokens.PACKED, cut(tokens.PACKED, 3)),
    ("packed-count", "warning", tokens.PACKED, longer(tokens.PACKED)),
    ("packed-count", "error", tokens.PACKED_HARMONICS, clear(tokens.PACKED_HARMONICS)),
    ("packed-count", "error", tokens.COLOR_RANGE, clear(tokens.COLOR_RANGE)),
    ("packed-count", "error", tokens.HARMONICS_RANGE, cut(tokens.HARMONICS_RANGE, 1)),
    ("range", "error", tokens.COLOR_RANGE, setting(tokens.COLOR_RANGE, put(0, 9e9))),
    ("range", "error", tokens.COLOR_RANGE, setting(tokens.COLOR_RANGE, put(1, np.nan))),
    ("range", "error", tokens.HARMONICS_RANGE, setting(tokens.HARMONICS_RANGE, put(0, -1))),
    ("range", "error", tokens.HARMONICS_RANGE, setting(tokens.HARMONICS_RANGE, put(0, np.inf))),
    ("degree", "error", tokens.SH_DEGREE, move(tokens.SH_DEGREE, 9)),
    ("not-finite", "error", "positions", setting("positions", put(2, np.nan))),
]


@pytest.mark.parametrize("form", ["float", "packed"])
@pytest.mark.parametrize("time", [None, 3.0])
def test_what_we_write_has_no_findings(stage: Usd.Stage, form: str, time: float | None) -> None:
    """Oracle: nothing is wrong with a cloud of legal numbers."""
    schema.author(stage, "/Splats", cloud(n=50, moving=True), form=form, time=time)
    assert validate(stage) == []


@pytest.mark.parametrize(("name", "severity", "attribute", "spoil"), STOCK_FAULTS)
def test_every_fault_of_a_stock_field_is_found(stage, name, severity, attribute, spoil) -> None:
    """Oracle: the fault that was made, on a field that had none."""
    prim = schema.author(stage, "/Splats", cloud(n=20, moving=True))
    spoil(prim)
    finding = found(stage)[name]
    assert (finding.severity, finding.attribute) == (severity, attribute)
    assert finding.path == "/Splats"
    assert finding.cure
    assert finding.message.startswith(f"/Splats.{attribute}: found ")
    assert ", expected " in finding.message


@pytest.mark.parametrize(("name", "severity", "attribute", "spoil"), PACKED_FAULTS)
def test_every_fault_of_a_packed_field_is_found(stage, name, severity, attribute, spoil) -> None:
    """Oracle: as above."""
    prim = schema.author(stage, "/Splats", cloud(n=20), form="packed")
    spoil(prim)
    finding = found(stage)[name]
    assert (finding.severity, finding.attribute) == (severity, attribute)


def test_a_message_counts_the_bad_splats_and_names_the_first(stage: Usd.Stage) -> None:
    """Oracle: the numbers that were put there."""
    prim = schema.author(stage, "/Splats", cloud(n=20))
    setting("opacities", put(slice(4, 6), 2.5))(prim)
    assert found(stage)["opacity-range"].found == "2 of 20 (first: 2.5 at splat 4)"


def test_degree_four_is_only_a_warning_for_others(stage: Usd.Stage) -> None:
    """Oracle: NVIDIA's rule VG.035 allows degrees 0 to 3."""
    schema.author(stage, "/Splats", cloud(n=5, degree=4))
    assert {name: f.severity for name, f in found(stage).items()} == {
        "interchange-degree": "warning"
    }


def test_half_alone_is_a_warning_for_others(stage: Usd.Stage) -> None:
    """Oracle: NVIDIA's rule VG.035 asks for the float attributes."""
    schema.author(stage, "/Splats", cloud(n=50), form="half")
    assert {name: f.severity for name, f in found(stage).items()} == {"half-only": "warning"}
    halves = ["orientationsh", "scalesh", "opacitiesh", f"{SH}h"]  # what NVIDIA's checker misses
    assert sorted(found(stage)["half-only"].found.removeprefix("only ").split(", ")) == sorted(
        halves
    )


def test_half_arrays_are_checked_like_float_ones(stage: Usd.Stage) -> None:
    """Oracle: the fault that was made."""
    prim = schema.author(stage, "/Splats", cloud(n=4), form="half")
    prim.GetAttribute("opacitiesh").Set(Vt.HalfArray([0.5, 2, 0.5, 0.5]))
    assert found(stage)["opacity-range"].attribute == "opacitiesh"


def test_a_prim_of_others_with_bare_centres_is_told_all_it_lacks(stage: Usd.Stage) -> None:
    """Oracle: the attributes that are not there."""
    stock_prim(stage, {"positions": three_points()})
    missing = {f.attribute for f in validate(stage) if f.code == "missing"}
    assert missing == {"orientations", "scales", "opacities", SH}


def test_counts_that_differ_at_one_time_are_found_there(stage: Usd.Stage) -> None:
    """Oracle: a sample of centres that the other arrays lack; USD holds theirs from time 1."""
    prim = schema.author(stage, "/Splats", cloud(1, n=5), time=1)
    more = Vt.Vec3fArray.FromNumpy(cloud(2, n=6).positions)
    prim.GetAttribute("positions").Set(more, 2)
    findings = [f for f in validate(stage) if f.code == "too-short"]
    assert {f.attribute for f in findings} == {"orientations", "scales", "opacities"}
    assert {f.time for f in findings} == {2.0}
    assert " at 2: found 5 values, expected 6" in findings[0].message
    assert not [f for f in validate(stage, time=1) if f.code == "too-short"]


def test_a_fault_of_many_samples_is_one_finding(stage: Usd.Stage) -> None:
    """Oracle: the number of samples, and the first of them."""
    for time in (1, 2, 3):
        schema.author(
            stage, "/Splats", replace(cloud(n=3), opacities=np.float32([2, 0, 0])), time=time
        )
    finding = found(stage)["opacity-range"]
    assert (finding.time, finding.samples) == (1, 3)
    assert finding.message.startswith("/Splats.opacities at 1 (and 2 more samples): found")


def test_a_fault_that_does_not_change_is_said_once_without_a_time(stage: Usd.Stage) -> None:
    """Oracle: an attribute without samples on a field with two."""
    for time in (1, 2):
        prim = schema.author(stage, "/Splats", cloud(n=3), time=time)
    prim.RemoveProperty("colorSpace:name")
    finding = found(stage)["no-color-space"]
    assert (finding.time, finding.samples) == (None, 1)


def test_instances_are_checked_once(stage: Usd.Stage) -> None:
    """Oracle: one fault in one prototype that appears twice."""
    prim = schema.author(stage, "/Source/Splats", cloud(n=3))
    stage.GetPrimAtPath("/Source").SetSpecifier(Sdf.SpecifierClass)
    setting("opacities", put(0, 2))(prim)
    for name in ("A", "B"):
        instance = stage.DefinePrim(f"/{name}")
        instance.GetReferences().AddInternalReference("/Source")
        instance.SetInstanceable(True)
    assert [f.path for f in validate(stage)] == ["/A/Splats"]


def test_other_prims_are_left_alone_and_the_stage_is_not_changed(stage: Usd.Stage) -> None:
    """Oracle: the stage's text before and after."""
    mesh = UsdGeom.Mesh.Define(stage, "/Mesh")
    mesh.CreatePointsAttr([Gf.Vec3f(float("nan"))])
    schema.author(stage, "/Splats", cloud(n=3), form="packed")
    before = stage.ExportToString()
    assert validate(stage) == []
    assert stage.ExportToString() == before


def test_progress_is_told_about_each_field(stage: Usd.Stage) -> None:
    """Oracle: a listener that writes down what it hears."""
    heard = []

    class Listener:
        def step(self, label: str, done: int, total: int) -> None:
            heard.append((label, done, total))

    schema.author(stage, "/A", cloud(n=3))
    schema.author(stage, "/B", cloud(n=3))
    validate(stage, progress=Listener())
    assert heard == [("validating", 0, 2), ("validating", 1, 2), ("validating", 2, 2)]


def test_an_extent_of_nothing_but_bad_splats_is_not_judged(stage: Usd.Stage) -> None:
    """Oracle: there is no box to compare with; the numbers themselves are found."""
    prim = schema.author(stage, "/Splats", cloud(n=1))
    setting("positions", put(0, np.nan))(prim)
    assert set(found(stage)) == {"not-finite"}


def test_an_array_that_begins_empty_is_a_warning_for_others(stage: Usd.Stage) -> None:
    """Oracle: usdVol's rule asks whether the float array has values at its earliest time."""
    for time, count in ((1, 0), (2, 7), (3, 7)):
        prim = schema.author(stage, "/Splats", cloud(n=count), time=time)
    faults = [f for f in validate(stage) if f.code == "empty-first"]
    assert {f.attribute for f in faults} == set(tokens.HALF_OF)
    assert {(f.severity, f.time, f.samples) for f in faults} == {("warning", 2, 2)}
    for name in tokens.HALF_OF:
        prim.GetAttribute(name).ClearAtTime(1)
    assert not [f for f in validate(stage) if f.code == "empty-first"]


@pytest.mark.parametrize("name", ["normals", "splat:confidence", "splat:occlusion"])
@pytest.mark.parametrize(("count", "code"), [(17, "too-short"), (20, ""), (23, "too-long")])
def test_normals_are_as_many_as_splats(stage: Usd.Stage, name: str, count: int, code: str) -> None:
    """Oracle: the numbers; normals of splats that move without them are nobody's."""
    prim = schema.author(stage, "/Splats", cloud(n=20))
    up, ones = np.tile(np.float32([0, 1, 0]), (20, 1)), np.ones(20, np.float32)
    schema.author_surface(prim, normals=up, confidence=ones, occlusion=ones)
    attribute = prim.GetAttribute(f"primvars:{name}")
    value = attribute.Get()
    attribute.Set(type(value)([value[0]] * count))
    findings = [(f.code, f.attribute) for f in validate(stage) if f.code != "no-color-space"]
    assert findings == ([(code, f"primvars:{name}")] if code else [])
    prim.GetAttribute("positions").Set(prim.GetAttribute("positions").Get(), 1)
    assert not [f for f in validate(stage) if name in f.attribute]


def test_what_is_compared_is_dated_by_what_changes(stage: Usd.Stage) -> None:
    """Oracle: 20 opacities that do not change, beside 20 centres at 1 and 21 at 2."""
    prim = schema.author(stage, "/Splats", cloud(n=20))
    positions = prim.GetAttribute("positions")
    for time, count in ((1, 20), (2, 21)):
        positions.Set(Vt.Vec3fArray(count, Gf.Vec3f(0)), time)
    short = {each.attribute: each for each in validate(stage) if each.code == "too-short"}
    finding = short["opacities"]
    assert finding.time == 2
    assert ".opacities at 2: found 20 values, expected 21 values" in finding.message


@pytest.mark.parametrize("name", ["projectionModeHint", "sortingModeHint"])
def test_a_hint_that_nobody_knows_is_found(stage: Usd.Stage, name: str) -> None:
    """Oracle: the schema's allowed tokens."""
    schema.author(stage, "/Splats", cloud(n=20)).GetAttribute(name).Set("sideways")
    finding = found(stage)["unknown-mode"]
    assert (finding.attribute, finding.found) == (name, "'sideways'")


@pytest.mark.parametrize("time", [None, 2.0])
def test_a_grade_out_of_range_is_found(stage: Usd.Stage, time: float | None) -> None:
    """With its time where it is animated. Oracle: the range in the schema."""
    prim = schema.author(stage, "/Splats", cloud())
    schema.author_grade(prim, time=1.0 if time else None, temperature=5000.0)
    assert found(stage) == {}
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    prim.GetAttribute("splat:grade:temperature").Set(10.0, code)
    finding = found(stage)["illegal-grade"]
    assert (finding.severity, finding.time) == ("error", time)
    assert finding.message.endswith("found 10, expected 1000 to 25000")
    assert ".splat:grade:temperature" in finding.message


def test_a_stage_that_does_not_say_how_large_it_is_is_warned_of() -> None:
    """Oracle: USD's own question whether the metadata is authored; without splats nobody cares."""
    bare = Usd.Stage.CreateInMemory()
    assert validate(bare) == []
    schema.author(bare, "/Splats", cloud(n=20))
    names = [(each.severity, each.code) for each in validate(bare) if each.path == "/"]
    assert names == [("warning", "no-up-axis"), ("warning", "no-meters-per-unit")]


@pytest.mark.filterwarnings("error")
def test_numbers_too_large_for_float32_are_judged_in_silence(stage: Usd.Stage) -> None:
    """Oracle: NumPy's warnings would be errors here."""
    prim = schema.author(stage, "/Splats", cloud(n=20))
    setting("positions", put(0, 1e30))(prim)
    setting("scales", put(0, 1e30))(prim)
    assert "extent-too-small" in {finding.code for finding in validate(stage)}


def test_newborn_splats_of_scale_0_need_no_thickness(stage: Usd.Stage) -> None:
    """Oracle: ids; at frame 2 a splat of scale 0 is new, or was there before."""
    first = replace(cloud(n=3), ids=np.arange(3))
    flat = first.scales.copy()
    flat[2] = 0
    for ids, words in (([0, 1, 7], "none is needed here"), ([0, 1, 2], "a small thickness")):
        prim = schema.author(stage, "/Splats", first, time=1)
        schema.author(stage, "/Splats", replace(first, scales=flat, ids=np.array(ids)), time=2)
        (found,) = [each for each in validate(stage) if each.code == "zero-scale"]
        assert words in found.cure and found.time == 2
        assert found.severity == ("note" if "none" in words else "warning")
        stage.RemovePrim(prim.GetPath())


@pytest.mark.parametrize(("opacity", "severity"), [(0.0, "note"), (0.5, "warning")])
def test_a_splat_of_scale_0_that_was_invisible_before_is_newborn(
    stage: Usd.Stage, opacity: float, severity: str
) -> None:
    """Oracle: the rows of a bake, where a splat has a row of opacity 0 before its birth, and ids
    are authored only where the number of rows changes."""
    first = replace(cloud(n=3), ids=np.arange(3))
    scales, opacities = first.scales.copy(), first.opacities.copy()
    scales[2], opacities[2] = 0, opacity
    prim = schema.author(stage, "/Splats", replace(first, opacities=opacities), time=1)
    schema.author(stage, "/Splats", replace(first, scales=scales), time=2)
    prim.GetAttribute(tokens.IDS).ClearAtTime(2)
    (found,) = [each for each in validate(stage) if each.code == "zero-scale"]
    assert (found.severity, found.time) == (severity, 2)
