"""Tests of exporting a stage over time as a sequence of captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.interchange.samples import assert_same
from tests.schema.clouds import cloud
from usdsplat import formats, schema
from usdsplat.core.errors import UnknownFormatError, UsageError
from usdsplat.interchange.exporting import export_capture
from usdsplat.interchange.options import SequenceOptions
from usdsplat.interchange.sequence_exporting import export_sequence
from usdsplat.interchange.sequences import import_sequence


def growing(times: tuple[float, ...] = (2, 3, 5)) -> Usd.Stage:
    """A field that has as many splats as the time says, and a second one that stands still."""
    stage = Usd.Stage.CreateInMemory()
    for time in times:
        schema.author(stage, "/Growing", cloud(n=int(time), degree=0), time=time)
    schema.author(stage, "/Still", cloud(n=10, degree=0))
    return stage


def test_a_sequence_comes_back(tmp_path: Path) -> None:
    """Oracle: the files that were imported, to the rounding of logits and logarithms."""
    for frame in (7, 8, 9):
        formats.write(cloud(seed=frame, n=frame), tmp_path / f"in.{frame}.ply")
    import_sequence(
        tmp_path / "in.%d.ply", tmp_path / "stage.usdc", sequence=SequenceOptions(clips=True)
    )
    report = export_sequence(tmp_path / "stage.usdc", tmp_path / "out.%04d.ply")
    assert (report.frames, report.counts, report.splats) == ((7, 8, 9), (7, 8, 9), 24)
    for frame in report.frames:
        before = formats.read(tmp_path / f"in.{frame:.0f}.ply").cloud
        after = formats.read(tmp_path / f"out.{frame:04.0f}.ply").cloud
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            found, expected = getattr(after, name), getattr(before, name)
            np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6, err_msg=name)


def test_the_stage_says_which_frames(tmp_path: Path) -> None:
    """Oracle: written out by hand; fields are held between samples, and merged."""
    stage = growing()
    stage.SetStartTimeCode(2)
    stage.SetEndTimeCode(5)
    report = export_sequence(stage, tmp_path / "out.####.ply")
    assert dict(zip(report.frames, report.counts, strict=True)) == {2: 12, 3: 13, 4: 13, 5: 15}
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"out.000{frame}.ply" for frame in (2, 3, 4, 5)
    ]
    assert report.prim_paths == ("/Growing", "/Still")


def test_without_a_range_samples_do(tmp_path: Path) -> None:
    """Oracle: the samples."""
    assert export_sequence(growing(), tmp_path / "out.####.ply").frames == (2, 3, 5)


def test_frames_that_are_asked_for_win(tmp_path: Path) -> None:
    """Oracle: the request, each frame once."""
    report = export_sequence(growing(), tmp_path / "out.####.#.ply", frames=(4.5, 3, 4.5))
    assert report.frames == (3, 4.5)
    assert (tmp_path / "out.0004.5.ply").is_file()


def test_transforms_of_the_frame_are_applied(tmp_path: Path) -> None:
    """Oracle: a field that walks along x, which is right in every frame of files."""
    stage = growing((1, 2))
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/Growing")).AddTranslateOp()
    move.Set((10, 0, 0), 1)
    move.Set((20, 0, 0), 2)
    export_sequence(stage, tmp_path / "out.%d.ply")
    for time in (1, 2):
        xs = formats.read(tmp_path / f"out.{time}.ply").cloud.positions[:time, 0]
        expected = cloud(n=time, degree=0).positions[:, 0] + 10 * time
        np.testing.assert_allclose(xs, expected, rtol=1e-6)


def test_an_export_that_is_asked_for_more_is_heeded(tmp_path: Path) -> None:
    """Oracle: `export_capture` with the same request."""
    stage = growing()

    def export(stage: Usd.Stage, path: Path, time: float):
        return export_capture(stage, path, time=time, prim_path="/Growing", axes="rub")

    report = export_sequence(stage, tmp_path / "out.####.ply", export=export)
    assert (report.counts, report.frame) == ((2, 3, 5), "rub")
    export(stage, tmp_path / "alone.ply", 5)
    found = formats.read(tmp_path / "out.0005.ply").cloud
    assert_same(found, formats.read(tmp_path / "alone.ply").cloud)


def test_what_cannot_be_a_sequence_is_refused(tmp_path: Path) -> None:
    """Oracle: a sentence for each, and nothing is written."""
    still = Usd.Stage.CreateInMemory()
    schema.author(still, "/Still", cloud(n=1, degree=0))
    with pytest.raises(UsageError, match=r"found no frames, expected a stage with a range of them"):
        export_sequence(still, tmp_path / "out.####.ply")
    with pytest.raises(UsageError, match=r"out\.ply: found no placeholder, expected one"):
        export_sequence(growing(), tmp_path / "out.ply")
    with pytest.raises(UsageError, match=r"found frame 2\.5, expected room for its fraction"):
        export_sequence(growing(), tmp_path / "out.####.ply", frames=(2.5,))
    with pytest.raises(UnknownFormatError):
        export_sequence(growing(), tmp_path / "out.####.xyz")
    still.SetStartTimeCode(0)
    for last, said in ((1e12, "1e\\+12"), (np.inf, "inf"), (np.nan, "nan"), (-0.5, "-0.5")):
        still.SetEndTimeCode(last)
        with pytest.raises(UsageError, match=f"codes 0 to {said}, expected 1 to 1000000 frames"):
            export_sequence(still, tmp_path / "out.####.ply")
    assert not list(tmp_path.iterdir())
