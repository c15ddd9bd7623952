"""Tests of joining captures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.formats.samples import random_cloud
from tests.interchange.samples import assert_same, capture, covariances
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.edits import Edit, parsed
from usdsplat.core.errors import FormatError, UsageError
from usdsplat.formats import Capture
from usdsplat.interchange.gathering import edit_capture, gather, joined

FLIP = np.diag([1.0, -1.0, -1.0])


def kept(name: str, **said: object) -> Capture:
    """A capture that was read, with other facts than usual."""
    cloud = random_cloud(20, 1, seed=len(name))
    return replace(
        Capture(cloud=cloud, format="PLY", files=(Path(name),), frame="rdf"),
        **said,
    )


def test_one_capture_is_itself() -> None:
    """Oracle: the same object: nothing is copied."""
    one = kept("a.ply")
    assert joined([one]) is one
    assert edit_capture(one, ()) is one


def test_others_are_turned_into_the_frame_of_the_first() -> None:
    """Oracle: rub to rdf is minus y and minus z, of centres and covariances; and the remark."""
    first, second = kept("a.ply"), kept("bb.spz", frame="rub", format="SPZ 3")
    both = joined([first, second])
    assert (both.frame, both.format, len(both.cloud)) == ("rdf", "PLY + SPZ 3", 40)
    np.testing.assert_array_equal(both.cloud.positions[:20], first.cloud.positions)
    expected = second.cloud.positions @ FLIP.astype(np.float32)
    np.testing.assert_array_equal(both.cloud.positions[20:], expected)
    turned = edit.take(both.cloud, np.arange(20, 40))
    np.testing.assert_allclose(
        covariances(turned), FLIP @ covariances(second.cloud) @ FLIP, atol=1e-5
    )
    assert both.notes == ("bb.spz was turned from rub to rdf",)


def test_bounds_and_modes_are_those_that_hold_for_all() -> None:
    """Oracle: written out by hand."""
    first = kept("a.ply", antialiased=True, error_bounds={"sh": "1/8"}, notes=("one", "both"))
    second = kept("b.ply", error_bounds={"sh": "1/16", "scales": "1 %"}, notes=("both",))
    both = joined([first, second])
    assert both.error_bounds == {"sh": "1/8 or 1/16", "scales": "exact or 1 %"}
    assert not both.antialiased
    assert both.notes[:2] == ("one", "both")
    assert "different rasterize modes" in both.notes[2]
    assert joined([first, replace(second, antialiased=True)]).antialiased


def test_colours_of_several_spaces_are_no_one_capture() -> None:
    """Oracle: the documented error."""
    linear = kept("b.ply", color_space="lin_rec709_scene")
    with pytest.raises(UsageError, match=r"^b\.ply: found colours in lin_rec709_scene, expected"):
        joined([kept("a.ply"), linear])


def test_numbers_that_are_not_finite_are_let_in_only_to_be_dropped(tmp_path: Path) -> None:
    """Oracle: the reader's refusal without the edit; with it the rows that are sound."""
    path = capture(tmp_path, n=9)
    raw = bytearray(path.read_bytes())
    body = raw.index(b"end_header\n") + len(b"end_header\n")
    raw[body : body + 4] = np.float32(np.nan).tobytes()  # x of the first splat
    bad = tmp_path / "bad.ply"
    bad.write_bytes(raw)
    with pytest.raises(FormatError, match="finite"):
        gather([bad])
    found = gather([bad], edits=[Edit(name="drop-nan")])
    assert_same(found.cloud, edit.take(formats.read(path).cloud, np.arange(1, 9)))
    assert any("not finite: 1" in note for note in found.notes)


def test_a_capture_tells_of_its_edits() -> None:
    """Oracle: bound and note by hand."""
    one = kept("a.ply", error_bounds={"positions": "0.1"})
    found = edit_capture(one, [parsed("scale", "3"), parsed("min-opacity", "0.5")])
    assert found.error_bounds == {"positions": "0.1, before scale 3"}
    assert found.notes == (f"min-opacity 0.5: {len(found.cloud)} splats of 20 left",)


def test_captures_of_different_units_are_joined_in_that_of_the_first() -> None:
    """Oracle: 1 m is 100 cm, of centres and of covariances; and the remark."""
    first = kept("a.glb", meters_per_unit=0.01)
    second = kept("bb.glb", meters_per_unit=1.0)
    both = joined([first, second])
    assert (both.meters_per_unit, both.unit_source) == (0.01, "file")
    larger = edit.take(both.cloud, np.arange(20, 40))
    np.testing.assert_allclose(larger.positions, 100 * second.cloud.positions, rtol=1e-6)
    np.testing.assert_allclose(covariances(larger), 1e4 * covariances(second.cloud), rtol=1e-4)
    np.testing.assert_array_equal(larger.sh, second.cloud.sh)
    assert both.notes == ("bb.glb was scaled by 100 to the unit of a.glb",)


def test_a_capture_without_a_unit_is_assumed_to_have_that_of_the_others() -> None:
    """Oracle: the same numbers, the unit of the one that states it, and the remark."""
    first, second = kept("a.ply"), kept("bb.glb", meters_per_unit=1.0)
    both = joined([first, second])
    assert both.meters_per_unit == 1.0
    np.testing.assert_array_equal(both.cloud.positions[:20], first.cloud.positions)
    np.testing.assert_array_equal(both.cloud.positions[20:], second.cloud.positions)
    assert both.notes == ("a.ply states no unit of length: that of bb.glb is assumed",)
    neither = joined([first, kept("c.ply")])
    assert (neither.meters_per_unit, neither.notes) == (None, ())


def test_a_unit_that_is_given_replaces_that_of_the_file(tmp_path: Path) -> None:
    """Oracle: glTF's unit is the metre; a .ply states none."""
    scan, scene = capture(tmp_path), tmp_path / "scene.glb"
    formats.write(formats.read(scan).cloud, scene)
    units = [
        (each.meters_per_unit, each.unit_source if each.meters_per_unit else None)
        for path in (scan, scene)
        for each in (gather([path]), gather([path], meters_per_unit=0.5))
    ]
    assert units == [(None, None), (0.5, "given"), (1.0, "file"), (0.5, "given")]


def test_a_given_unit_other_than_that_of_the_file_is_noted(tmp_path: Path) -> None:
    """Oracle: glTF's unit is the metre; a .ply states none, which is no contradiction."""
    scan, scene = capture(tmp_path), tmp_path / "scene.glb"
    formats.write(formats.read(scan).cloud, scene)
    (note,) = set(gather([scene], meters_per_unit=0.01).notes) - set(gather([scene]).notes)
    assert note == "one unit is 0.01 m as given to the import, not 1 m"
    assert gather([scene], meters_per_unit=1.0).notes == gather([scene]).notes
    assert gather([scan], meters_per_unit=0.01).notes == gather([scan]).notes
