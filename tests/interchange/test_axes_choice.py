"""Tests of choosing the axes of captures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.formats.samples import random_cloud
from tests.interchange.samples import read_ply
from tests.interchange.test_frame_guess import cone, turned
from usdsplat import formats, schema
from usdsplat.core.errors import UsageError
from usdsplat.formats import Capture
from usdsplat.formats.capture import UNKNOWN_AXES
from usdsplat.interchange import convert, import_capture, import_sequence
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.gathering import gather
from usdsplat.interchange.options import ImportOptions

RDF = (
    *("playbot_lod2.sog", "playbot_lod3.sog", "playbot_lod4.sog", "playbot_lod5.sog"),
    *("playbot_lod6.sog", "flowers_lod2_0.sog", "flowers_lod3_0.sog", "guitar.compressed.ply"),
    *("statue_angel.sog", "statue_massa.sog", "statue_trumpet.sog", "pod.spz"),
)
"""Real captures that stand upright if y points down."""


def found(cloud, **said: object) -> Capture:
    """A capture as a reader gives it whose format does not state the axes."""
    facts = {"frame": "rdf", "frame_source": "assumed", "notes": ("other", UNKNOWN_AXES), **said}
    return Capture(cloud=cloud, format="PLY", files=(Path("a.ply"),), **facts)


@pytest.mark.parametrize("frame", ["rdf", "rub", "rfu"])
def test_the_splats_decide_where_the_file_says_nothing(frame: str) -> None:
    """Oracle: how the cloud was made."""
    capture = found(turned(cone(), frame))
    choice = choose_axes(capture)
    assert (choice.frame, choice.source) == (frame, "evidence")
    assert choice.score > 0.69
    settled = with_axes(capture, choice)
    assert (settled.frame, settled.frame_source, settled.frame_score) == (
        frame,
        "evidence",
        choice.score,
    )
    assert settled.notes[1:] == ("other",)
    assert f"{frame!r} by the evidence (with " in settled.notes[0]
    assert choose_axes(capture, "auto") == choice


def test_without_evidence_the_axes_are_the_customary_ones() -> None:
    """Oracle: a ball, which looks alike from everywhere, and the note that says so."""
    capture = found(random_cloud(3000, 0))
    settled = with_axes(capture, choose_axes(capture))
    assert (settled.frame, settled.frame_source, settled.frame_score) == ("rdf", "assumed", None)
    assert settled.notes[0].startswith(f"{UNKNOWN_AXES} (no direction is clearly best")
    assert settled.notes[1:] == ("other",)


def test_the_word_of_the_file_counts_more_than_its_splats() -> None:
    """Oracle: the same object: nothing is guessed."""
    capture = found(turned(cone(), "rdf"), frame="rub", frame_source="file", notes=())
    choice = choose_axes(capture)
    assert (choice.frame, choice.source, choice.note) == ("rub", "file", "")
    assert with_axes(capture, choice) is capture


def test_axes_that_are_given_count_most() -> None:
    """Oracle: the caller's; nothing is said to be unknown then."""
    for source in ("file", "assumed"):
        capture = found(turned(cone(), "rdf"), frame_source=source)
        settled = with_axes(capture, choose_axes(capture, "rfu"))
        assert (settled.frame, settled.frame_source) == ("rfu", "given")
        assert settled.notes == ("other",)


def test_every_real_capture_stands_upright(data: Path) -> None:
    """Oracle: the data's README, and pictures: a kettle on its mat, a head above its chin."""
    expected = {data / "splats" / name: "rdf" for name in RDF}
    expected[data / "splats" / "statue_angel.compressed.ply"] = "rub"
    expected[data / "derived_ply" / "playbot_lod4_sh2.ply"] = "rdf"
    expected |= dict.fromkeys((data / "seq_synthetic").glob("*.sog"), "rdf")
    chosen = {path: gather([path]).frame for path in expected}
    assert chosen == expected


def test_two_files_of_one_statue_are_joined_in_one_place(data: Path) -> None:
    """Oracle: the data's README: half a turn about z apart; their boxes on the stage."""
    boxes = []
    for name in ("statue_angel.sog", "statue_angel.compressed.ply"):
        stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, "Y")
        report = import_capture(data / "splats" / name, stage)
        assert report.frame_source == "evidence"
        prim = stage.GetPrimAtPath(report.prim_path)
        world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))[:3, :3]
        places = schema.fetch(prim).positions @ world
        boxes.append(np.percentile(places[:, 1], [5, 50, 95]))
    np.testing.assert_allclose(*boxes, atol=0.05)


def test_the_prim_remembers_the_axes_and_where_they_are_from(tmp_path: Path) -> None:
    """Oracle: how the clouds were made, and the option."""
    told = []
    for name, cloud, axes in (
        ("cone", turned(cone(), "rub"), None),
        ("ball", random_cloud(3000, 0), "auto"),
        ("given", random_cloud(3000, 0), "rfu"),
    ):
        formats.write(cloud, tmp_path / f"{name}.ply")
        stage = Usd.Stage.CreateInMemory()
        report = import_capture(tmp_path / f"{name}.ply", stage, options=ImportOptions(axes=axes))
        memory = stage.GetPrimAtPath(report.prim_path).GetCustomDataByKey("usdsplat")
        assert memory["frame_source"] == report.frame_source
        told.append((memory["frame"], memory["frame_source"], "frame_score" in memory))
    assert told == [("rub", "evidence", True), ("rdf", "assumed", False), ("rfu", "given", False)]


def test_the_first_frame_decides_for_a_sequence(tmp_path: Path) -> None:
    """Oracle: the first frame's axes, although another frame alone would get others."""
    for frame, axes in ((1, "rub"), (2, "rdf")):
        formats.write(turned(cone(), axes), tmp_path / f"cap.{frame}.ply")
    assert gather([tmp_path / "cap.2.ply"]).frame == "rdf"
    report = import_sequence(tmp_path / "cap.%d.ply", tmp_path / "a.usda")
    assert (report.frame, report.frame_source) == ("rub", "evidence")
    assert [note for note in report.notes if "by the evidence" in note] != []
    assert not any(note.startswith("frame") for note in report.notes)


def test_a_guess_is_not_written_to_a_capture(tmp_path: Path) -> None:
    """Oracle: the numbers of the source, and an SPZ that states no axes."""
    source = turned(cone(), "rub")
    formats.write(source, tmp_path / "a.ply")
    for options in (ImportOptions(), ImportOptions(axes="auto")):
        convert(tmp_path / "a.ply", tmp_path / "b.ply", options=options)
        before, after = (read_ply(tmp_path / name)["positions"] for name in ("a.ply", "b.ply"))
        np.testing.assert_array_equal(after, before)
    convert(tmp_path / "a.ply", tmp_path / "c.spz")
    assert not formats.read(tmp_path / "c.spz").states_frame


def test_axes_that_are_none_are_refused() -> None:
    """Oracle: one sentence."""
    with pytest.raises(UsageError):
        choose_axes(replace(found(cone()), frame="rrr"))
