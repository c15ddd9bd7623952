"""Tests that suffixes select the kind of conversion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.interchange.samples import capture, covariances, read_ply
from usdsplat import formats, schema
from usdsplat.core.errors import OutputError, UnknownFormatError
from usdsplat.interchange import (
    ExportReport,
    ImportReport,
    RepackReport,
    convert,
    import_capture,
)
from usdsplat.interchange.options import ImportOptions
from usdsplat.interchange.provenance import joined_bounds


def test_a_capture_becomes_a_stage_and_a_capture_again(tmp_path: Path) -> None:
    """Oracle: plyfile on the first and the last file, and the kinds of report."""
    source = capture(tmp_path)
    stage, packed, back = (tmp_path / name for name in ("a.usda", "b.usdc", "c.ply"))
    assert isinstance(
        convert(source, stage, options=ImportOptions(up_axis="Z", prim_path="/Tree")), ImportReport
    )
    assert isinstance(convert(stage, packed, options=ImportOptions(form="packed")), RepackReport)
    opened = Usd.Stage.Open(str(packed))
    assert schema.is_packed(opened.GetPrimAtPath("/Tree"))
    assert isinstance(convert(packed, back, options=ImportOptions(prim_path="/Tree")), ExportReport)
    np.testing.assert_allclose(
        read_ply(back)["positions"], read_ply(source)["positions"], atol=1e-6
    )


def test_a_capture_becomes_another_capture(data: Path, tmp_path: Path) -> None:
    """Oracle: plyfile's reading of the decoded twin that another program made."""
    report = convert(data / "oracle" / "out.sog", tmp_path / "a.ply")
    assert isinstance(report, ExportReport)
    assert (report.splats, report.prim_paths, report.frame) == (1000, (), "rdf")
    twin = read_ply(data / "oracle" / "rt_sog.ply")
    found = read_ply(tmp_path / "a.ply")
    np.testing.assert_allclose(found["positions"], twin["positions"], atol=1e-5)
    np.testing.assert_allclose(found["sh"], twin["sh"], atol=1e-5)


def test_a_capture_can_be_turned_on_the_way(tmp_path: Path) -> None:
    """Oracle: right-down-forward to right-up-back is minus y and minus z."""
    source = capture(tmp_path)
    convert(source, tmp_path / "turned.ply", options=ImportOptions(axes="rub"))
    before, after = (formats.read(p).cloud for p in (source, tmp_path / "turned.ply"))
    flip = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_array_equal(after.positions, before.positions @ flip.astype(np.float32))
    expected = flip @ covariances(before) @ flip
    np.testing.assert_allclose(covariances(after), expected, atol=1e-5)


def test_a_file_whose_name_could_be_a_sequence_is_itself(tmp_path: Path) -> None:
    """Oracle: a person's expectation of a file that is there."""
    source = capture(tmp_path).rename(tmp_path / "take#2.ply")
    assert convert(source, tmp_path / "a.usda").splats == len(formats.read(source).cloud)
    assert Usd.Stage.Open(str(tmp_path / "a.usda")).GetDefaultPrim()
    assert type(convert(source, tmp_path / "b.ply")) is ExportReport


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    """Oracle: the documented errors."""
    source = capture(tmp_path)
    with pytest.raises(UnknownFormatError):
        convert(source, tmp_path / "a.xyz")
    with pytest.raises(OutputError, match="being read"):
        convert(source, source)


@pytest.mark.parametrize(("suffix", "degree"), [(".splat", 0), (".glb", 3), (".ply", 4)])
def test_harmonics_that_a_format_has_no_place_for_are_said_to_go(tmp_path, suffix, degree) -> None:
    """Oracle: the formats' own words on their degrees; a stage and a capture say the same."""
    source = capture(tmp_path, n=5, degree=4)
    convert(source, tmp_path / "a.usdc")
    for first in (source, tmp_path / "a.usdc"):
        report = convert(first, tmp_path / f"b{suffix}")
        assert isinstance(report, ExportReport)
        assert report.degree == degree == formats.read(tmp_path / f"b{suffix}").cloud.sh_degree
        said = f"harmonics above degree {degree} are not written: {suffix} cannot store them"
        assert (said in report.notes) == (degree < 4)


def test_what_has_no_bound_gets_none_by_what_writing_costs():
    """Oracle: rounding adds to a bound, and to no bound nothing."""
    merged = "unbounded: splats were merged by decimate 25%"
    joined = joined_bounds({"scales": merged, "sh": "1/8"}, {"scales": "1 %", "sh": "1/16"})
    assert joined == {"scales": merged, "sh": "1/8 + 1/16"}


def test_sizes_survive_a_way_through_glb(tmp_path: Path) -> None:
    """Oracle: the centres of the first stage, in metres: stage in cm, glb, stage in cm."""
    source = capture(tmp_path)
    first, middle, last = (tmp_path / name for name in ("a.usda", "b.glb", "c.usda"))
    in_cm = ImportOptions(meters_per_unit=0.01)
    convert(source, first, options=in_cm)
    convert(first, middle)
    stage = Usd.Stage.CreateNew(str(last))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    import_capture(middle, stage)
    stage.Save()
    convert(last, tmp_path / "back.ply")
    before, after = read_ply(source)["positions"], read_ply(tmp_path / "back.ply")["positions"]
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-7)


def test_a_stage_joins_a_capture_in_the_unit_of_the_target(tmp_path: Path) -> None:
    """Oracle: centres by hand: both parts in metres, whichever comes first."""
    scan = capture(tmp_path)
    convert(scan, tmp_path / "a.usda", options=ImportOptions(meters_per_unit=0.01))
    convert(tmp_path / "a.usda", tmp_path / "small.glb")
    centres = formats.read(tmp_path / "small.glb").cloud.positions
    for order in (("a.usda", "small.glb"), ("small.glb", "a.usda")):
        convert([tmp_path / name for name in order], tmp_path / "both.glb")
        found = formats.read(tmp_path / "both.glb").cloud.positions
        np.testing.assert_allclose(found, np.tile(centres, (2, 1)), rtol=1e-5, atol=1e-9)
