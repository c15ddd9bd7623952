"""Tests of importing a sequence of captures as an animated splat field."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.interchange.samples import assert_same, capture
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.edits import parsed
from usdsplat.core.errors import FormatError, OutputError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.opening import open_capture
from usdsplat.interchange.options import ImportOptions, SequenceOptions
from usdsplat.interchange.sequences import import_sequence

COUNTS = {1: 12, 2: 40, 3: 40, 4: 7}
"""Splats of each frame that `sequence` writes."""


def sequence(folder: Path, counts: dict[int, int] = COUNTS, *, degree: int = 1) -> Path:
    """Captures of random splats; returns their pattern."""
    for frame, count in counts.items():
        capture(folder, f"cap.{frame:04d}.ply", seed=frame, n=count, degree=degree)
    return folder / "cap.####.ply"


def opened(path: Path, prim_path: str = "/cap/splats") -> tuple[Usd.Stage, Usd.Prim]:
    """The stage, which must be kept, and its field."""
    stage = Usd.Stage.Open(str(path))
    return stage, stage.GetPrimAtPath(prim_path)


@pytest.mark.parametrize("clips", [False, True])
@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc"])
def test_each_frame_is_its_capture(tmp_path: Path, suffix: str, clips: bool) -> None:
    """Oracle: the reader, which has oracles of its own; between frames the earlier one is held."""
    target = tmp_path / f"out{suffix}"
    report = import_sequence(
        sequence(tmp_path), target, sequence=SequenceOptions(clips=clips, rate=25)
    )
    assert (report.frames, report.counts) == (tuple(COUNTS), tuple(COUNTS.values()))
    assert (report.prim_path, report.splats) == ("/cap/splats", sum(COUNTS.values()))
    stage, prim = opened(target)
    assert schema.sample_times(prim) == list(COUNTS)
    for frame in COUNTS:
        read = formats.read(tmp_path / f"cap.{frame:04d}.ply").cloud
        for time in (frame, frame + 0.5):
            assert_same(replace(schema.fetch(prim, time), ids=None), read)
        box = np.array(UsdGeom.Boundable(prim).GetExtentAttr().Get(frame))
        np.testing.assert_array_equal(box, schema.compute_extent(read))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 4)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 25
    assert stage.GetDefaultPrim().GetPath() == "/cap"
    assert schema.validate(stage) == []


@pytest.mark.parametrize("clips", [False, True])
@pytest.mark.parametrize("form", ["half", "packed"])
def test_other_forms_hold_what_they_hold_of_one_capture(tmp_path, form: str, clips: bool) -> None:
    """Oracle: `schema.author` and `schema.fetch` of each capture alone."""
    target = tmp_path / "out.usdc"
    import_sequence(
        sequence(tmp_path),
        target,
        options=ImportOptions(form=form),
        sequence=SequenceOptions(clips=clips),
    )
    stage, prim = opened(target)
    assert schema.form_of(prim) == form
    alone = Usd.Stage.CreateInMemory()
    for frame in COUNTS:
        read = formats.read(tmp_path / f"cap.{frame:04d}.ply").cloud
        field = schema.author(alone, f"/Frame{frame}", read, form=form)
        assert_same(replace(schema.fetch(prim, frame), ids=None), schema.fetch(field))
    found = [finding.code for finding in schema.validate(stage)]
    assert found == (["half-only"] if form == "half" else [])


@pytest.mark.parametrize("clips", [False, True])
def test_rows_that_are_the_same_splats_move_between_frames(tmp_path: Path, clips: bool) -> None:
    """Oracle: the mean of two frames, by hand; a frame of another count is held."""
    target = tmp_path / "out.usdc"
    report = import_sequence(
        sequence(tmp_path), target, sequence=SequenceOptions(interpolate=True, clips=clips)
    )
    assert not any("held" in note for note in report.notes)
    _stage, prim = opened(target)
    clouds = {frame: schema.fetch(prim, frame) for frame in COUNTS}
    middle = (clouds[2].positions + clouds[3].positions) / 2
    np.testing.assert_allclose(schema.fetch(prim, 2.5).positions, middle, atol=1e-6)
    assert_same(schema.fetch(prim, 3.5), clouds[3])


@pytest.mark.parametrize("clips", [False, True])
def test_frames_look_like_their_captures(data: Path, tmp_path: Path, clips: bool) -> None:
    """Oracle: pictures of two captures alone, bit for bit; their order of splats changes."""
    target = tmp_path / "monkey.usdc"
    report = import_sequence(
        data / "seq_synthetic" / "monkey_%04d.sog", target, sequence=SequenceOptions(clips=clips)
    )
    assert report.frames == (1, 2, 3, 4, 5, 6)
    with Engine(Usd.Stage.Open(str(target)), time=2.0) as engine:
        view = engine.view(resolution=(96, 64))
        pictures = [engine.picture(view)["color"].copy()]
        engine.set_time(5.0)
        pictures.append(engine.picture(view)["color"].copy())
    assert not np.array_equal(*pictures)
    for frame, picture in zip((2, 5), pictures, strict=True):
        with Engine(open_capture(data / "seq_synthetic" / f"monkey_{frame:04d}.sog")) as engine:
            expected = engine.picture(view)["color"]
        np.testing.assert_array_equal(picture, expected)
        assert expected[..., 3].max() > 0.5


def test_a_package_holds_a_sequence(tmp_path: Path) -> None:
    """Oracle: the reader; a package has no place for clips beside it."""
    import_sequence(sequence(tmp_path), tmp_path / "out.usdz")
    _stage, prim = opened(tmp_path / "out.usdz")
    read = formats.read(tmp_path / "cap.0003.ply").cloud
    assert_same(replace(schema.fetch(prim, 3), ids=None), read)
    with pytest.raises(UsageError, match=r"clips: found a \.usdz target, expected"):
        import_sequence(
            tmp_path / "cap.####.ply", tmp_path / "clips.usdz", sequence=SequenceOptions(clips=True)
        )
    assert not (tmp_path / "clips.usdz").exists()


def test_chosen_frames_may_leave_gaps(tmp_path: Path) -> None:
    """Oracle: the choice; the numbers stay the time codes."""
    pattern = sequence(tmp_path)
    report = import_sequence(
        pattern, tmp_path / "out.usdc", sequence=SequenceOptions(frames=(4, 1))
    )
    assert report.frames == (1, 4)
    _stage, prim = opened(tmp_path / "out.usdc")
    assert [len(schema.fetch(prim, time)) for time in (1, 3, 4)] == [12, 12, 7]


def test_axes_are_turned_as_for_one_capture(tmp_path: Path) -> None:
    """Oracle: right-down-forward in words, z up: x stays, forward becomes y, down minus z."""
    pattern = sequence(tmp_path)
    for bake in (False, True):
        report = import_sequence(
            pattern, tmp_path / "out.usdc", options=ImportOptions(up_axis="Z", bake_axes=bake)
        )
        stage, prim = opened(tmp_path / "out.usdc")
        assert UsdGeom.GetStageUpAxis(stage) == "Z"
        matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))[:3, :3]
        x, y, z = formats.read(tmp_path / "cap.0002.ply").cloud.positions.T
        world = schema.fetch(prim, 2).positions @ matrix
        np.testing.assert_allclose(world, np.stack([x, z, -y], axis=1), atol=1e-6)
        where = "in the arrays" if bake else "by xformOp:transform:axes"
        assert report.axes == f"rdf to rfu {where}"
        del stage, prim


def test_the_field_remembers_its_files(tmp_path: Path) -> None:
    """Oracle: hashlib, by the definition for several files."""
    pattern = sequence(tmp_path, {1: 3, 2: 3})
    import_sequence(pattern, tmp_path / "out.usda")
    _stage, prim = opened(tmp_path / "out.usda")
    memory = prim.GetCustomDataByKey("usdsplat")
    total = hashlib.sha256()
    for name in ("cap.0001.ply", "cap.0002.ply"):
        total.update(
            f"{name}\0{hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()}\n".encode()
        )
    assert (memory["source"], memory["sha256"]) == ("cap.####.ply", total.hexdigest())
    assert memory["format"] == "PLY, binary little endian"


def test_every_frame_is_edited_in_its_own_coordinates(tmp_path: Path) -> None:
    """Oracle: the edits done to each file alone, and the provenance."""
    edits = [parsed("translate", "0,1,0"), parsed("crop-box", "-9,1,-9,9,9,9")]
    report = import_sequence(sequence(tmp_path), tmp_path / "out.usdc", edits=edits)
    clouds = [formats.read(path).cloud for path in sorted(tmp_path.glob("*.ply"))]
    kept = [edit.take(cloud, cloud.positions[:, 1] >= 0) for cloud in clouds]
    assert report.counts == tuple(map(len, kept))
    assert report.edits == ("translate 0,1,0", "crop-box -9,1,-9,9,9,9")
    _stage, prim = opened(tmp_path / "out.usdc")
    for time, cloud in zip(report.frames, kept, strict=True):
        expected = cloud.positions + np.float32([0, 1, 0])
        np.testing.assert_allclose(schema.fetch(prim, time).positions, expected, atol=1e-6)
    with pytest.raises(UsageError, match=r"^edit crop-box: found interpolation between frames"):
        import_sequence(
            tmp_path / "cap.####.ply",
            tmp_path / "out.usdc",
            edits=edits,
            sequence=SequenceOptions(interpolate=True),
        )


@pytest.mark.parametrize("clips", [False, True])
def test_what_is_interrupted_leaves_nothing(tmp_path: Path, clips: bool) -> None:
    """Oracle: the folder before; an older target is untouched."""
    pattern = sequence(tmp_path)
    target = tmp_path / "out.usdc"
    target.write_text("older")
    before = sorted(tmp_path.iterdir())

    def tired(path: Path) -> formats.Capture:
        if path.name == "cap.0003.ply":
            raise KeyboardInterrupt
        return formats.read(path)

    with pytest.raises(KeyboardInterrupt):
        import_sequence(pattern, target, sequence=SequenceOptions(clips=clips), read=tired)
    assert sorted(tmp_path.iterdir()) == before
    assert target.read_text() == "older"


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on file sizes")
@pytest.mark.parametrize(
    ("suffix", "limit", "clips"),
    [
        (".usdc", 60_000, False),
        (".usda", 150_000, False),
        (".usdz", 60_000, False),
        (".usdc", 40_000, True),
    ],
)
def test_a_disk_that_is_full_leaves_nothing(tmp_path, suffix: str, limit: int, clips: bool) -> None:
    """In the middle of the frames; for text, whose file is the largest, after them. Oracle: the
    kernel's limit on file sizes; one sentence, and the folder before."""
    pattern = sequence(tmp_path, {1: 300, 2: 300, 3: 600})
    before = sorted(tmp_path.iterdir())
    code = f"""
import resource, sys
from usdsplat.core.errors import OutputError
from usdsplat.interchange import SequenceOptions, import_sequence
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    import_sequence(sys.argv[1], sys.argv[2], sequence=SequenceOptions(clips={clips}))
except OutputError as error:
    print(error)
"""
    command = [sys.executable, "-c", code, str(pattern), str(tmp_path / f"out{suffix}")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"{tmp_path}/out{suffix}: found " in done.stdout
    assert len(done.stdout.splitlines()) == 1
    assert sorted(tmp_path.iterdir()) == before


def test_frames_that_cannot_be_one_field_are_refused(tmp_path: Path) -> None:
    """Oracle: the degree is uniform; the sentence names the file and the first frame's degree."""
    pattern = sequence(tmp_path)
    capture(tmp_path, "cap.0003.ply", degree=2)
    with pytest.raises(FormatError, match=r"cap\.0003\.ply: found degree .* 2, expected 1, as in"):
        import_sequence(pattern, tmp_path / "out.usdc")
    assert not (tmp_path / "out.usdc").exists()


@pytest.mark.parametrize("rate", [0.0, -24.0, float("inf"), float("nan")])
def test_a_rate_that_is_none_is_refused(tmp_path: Path, rate: float) -> None:
    """Oracle: one sentence, and nothing is written."""
    with pytest.raises(UsageError, match=r"rate: found .*, expected a positive number"):
        import_sequence(
            sequence(tmp_path), tmp_path / "out.usdc", sequence=SequenceOptions(rate=rate)
        )


def test_something_else_at_the_prim_path_is_no_matter_in_a_new_file(tmp_path: Path) -> None:
    """Oracle: the path that is asked for; one that is none is refused."""
    pattern = sequence(tmp_path, {1: 3})
    report = import_sequence(
        pattern, tmp_path / "a.usdc", options=ImportOptions(prim_path="/Set/Tree")
    )
    assert report.prim_path == "/Set/Tree"
    assert not any("held" in note for note in report.notes)
    with pytest.raises(UsageError, match="expected the path of a prim"):
        import_sequence(pattern, tmp_path / "b.usdc", options=ImportOptions(prim_path="Tree"))
    assert not (tmp_path / "b.usdc").exists()


def test_clips_replace_clips_and_nothing_else(tmp_path: Path) -> None:
    """Oracle: the files of the folder; what is not a clip is somebody's."""
    pattern = sequence(tmp_path)
    folder = tmp_path / "out.clips"
    import_sequence(pattern, tmp_path / "out.usdc", sequence=SequenceOptions(clips=True))
    import_sequence(
        pattern, tmp_path / "out.usdc", sequence=SequenceOptions(clips=True, frames=(2, 3))
    )
    names = ["frame.0002.usdc", "frame.0003.usdc", "manifest.usda", "topology.usda"]
    assert sorted(path.name for path in folder.iterdir()) == names
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(
        OutputError, match=r"out\.clips: found something that is not a folder of clips"
    ):
        import_sequence(pattern, tmp_path / "out.usdc", sequence=SequenceOptions(clips=True))
    assert (folder / "notes.txt").read_text() == "mine"
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_clips_travel_with_their_stage(tmp_path: Path) -> None:
    """Oracle: the reader, after the folder was renamed; a clip can be looked at by itself."""
    (tmp_path / "here").mkdir()
    pattern = sequence(tmp_path)
    import_sequence(
        pattern,
        tmp_path / "here" / "out.usda",
        sequence=SequenceOptions(clips=True),
        options=ImportOptions(up_axis="Z"),
    )
    (tmp_path / "here").rename(tmp_path / "there")
    _stage, prim = opened(tmp_path / "there" / "out.usda")
    read = formats.read(tmp_path / "cap.0002.ply").cloud
    assert_same(replace(schema.fetch(prim, 2), ids=None), read)
    topology = Usd.Stage.Open(str(tmp_path / "there" / "out.clips" / "topology.usda"))
    assert not topology.HasAuthoredTimeCodeRange()
    alone, prim = opened(tmp_path / "there" / "out.clips" / "frame.0002.usdc")
    assert_same(replace(schema.fetch(prim), ids=None), read)
    assert UsdGeom.GetStageUpAxis(alone) == "Z"
    assert (alone.GetStartTimeCode(), alone.GetEndTimeCode()) == (2, 2)


def test_fractions_of_frames_are_times(tmp_path: Path) -> None:
    """Oracle: the names."""
    for number, text in enumerate(("0001.00", "0001.50", "0002.00")):
        capture(tmp_path, f"cap.{text}.ply", seed=number, n=3 + number, degree=0)
    report = import_sequence(
        tmp_path / "cap.####.##.ply", tmp_path / "out.usdc", sequence=SequenceOptions(clips=True)
    )
    assert report.frames == (1, 1.5, 2)
    _stage, prim = opened(tmp_path / "out.usdc")
    assert [len(schema.fetch(prim, time)) for time in (1, 1.25, 1.5, 2)] == [3, 3, 4, 5]


@pytest.mark.parametrize("clips", [False, True])
def test_the_proxy_of_a_packed_sequence_shows_each_frame(tmp_path: Path, clips: bool) -> None:
    """Oracle: the captures' centres, and the field's place."""
    import_sequence(
        sequence(tmp_path),
        tmp_path / "out.usda",
        options=ImportOptions(form="packed"),
        sequence=SequenceOptions(clips=clips),
    )
    stage, prim = opened(tmp_path / "out.usda")
    points = UsdGeom.Points(UsdGeom.Imageable(prim).ComputeProxyPrim()[0])
    for frame in COUNTS:
        read = formats.read(tmp_path / f"cap.{frame:04d}.ply").cloud
        np.testing.assert_array_equal(points.GetPointsAttr().Get(frame), read.positions)
        places = UsdGeom.XformCache(frame)
        world = [places.GetLocalToWorldTransform(each) for each in (prim, points.GetPrim())]
        assert world[0] == world[1] != Gf.Matrix4d(1)
    assert stage.GetCompositionErrors() == []
