"""Tests of the surveys of inputs, and of the coordinates in which they meet."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from usdsplat.core.errors import StageError, UsageError
from usdsplat.interchange.lod import survey
from usdsplat.interchange.lod.survey import Survey, meet
from usdsplat.interchange.outliers import weighted_median
from usdsplat.schema import DrawingHints

ONE = Survey(
    name="a.ply",
    files=("a.ply",),
    parts=(100,),
    degree=1,
    low=(-1.0, -2.0, -3.0),
    high=(1.0, 2.0, 3.0),
    core_low=(-1.0, -2.0, -3.0),
    core_high=(1.0, 2.0, 3.0),
    pixel=0.01,
    frame="rdf",
    frame_source="file",
    frame_score=0.0,
    meters_per_unit=None,
    unit_source="file",
    antialiased=False,
    projection_modes=("perspective",),
    sorting_modes=("zDepth",),
    footprints=(0.0, 0.0),
    color_space="srgb_rec709_scene",
    format="PLY",
    error_bounds={},
    notes=("a note",),
)


def met(*surveys, sh_degree=None, pixel=None):
    """The meeting of these inputs."""
    return meet(surveys, sh_degree=sh_degree, pixel=pixel)


def test_a_survey_survives_json():
    """Oracle: the survey."""
    value = json.loads(json.dumps(ONE.as_json()))
    assert Survey.from_json(value) == ONE


def test_a_single_input_keeps_its_coordinates():
    """Oracle: closed form: the identity, and the cube of the longest edge."""
    found = met(ONE)
    np.testing.assert_array_equal(found.maps[0], np.eye(4))
    assert (found.frame, found.cube.edge, found.pixel, found.degree) == ("rdf", 6.0, 0.01, 1)
    assert found.notes == ("a note",)


def test_others_are_turned_and_scaled_to_the_first():
    """Oracle: closed form: rub is rdf with y and z negated, and centimetres are 1/100 of metres;
    the first input has the unit of the only one that states it."""
    first = replace(ONE, meters_per_unit=1.0)
    found = met(first, replace(ONE, name="b.ply", frame="rub", meters_per_unit=0.01))
    np.testing.assert_allclose(found.maps[1], np.diag([0.01, -0.01, -0.01, 1]))
    assert met(ONE, replace(ONE, meters_per_unit=0.01)).meters_per_unit == 0.01
    assert "b.ply: scaled by 0.01 to the unit of a.ply" in found.notes
    assert "b.ply: turned from rub to rdf" in found.notes
    assert "2 inputs: a note" in found.notes


def test_outliers_do_not_enlarge_the_cube():
    """Oracle: closed form: MARGIN times the box of the others, and no more than all."""
    far = replace(ONE, low=(-1e6, -2.0, -3.0))
    assert met(far).cube.edge == pytest.approx(1 + 6 * survey.MARGIN / 2)
    assert met(replace(ONE, low=(-4.0, -2.0, -3.0))).cube.edge == 6.0


def test_the_pixel_is_that_of_half_of_the_splats():
    """Oracle: closed form; antialiased inputs need no low-pass, and a given size is kept."""
    many = replace(ONE, parts=(200, 300), pixel=0.5)
    assert met(ONE, many).pixel == 0.5
    assert met(replace(ONE, antialiased=True)).pixel == 0.0
    assert met(ONE, replace(ONE, antialiased=True)).pixel == 0.01
    assert met(replace(ONE, antialiased=True), pixel=0.2).pixel == 0.2


def test_inputs_without_axes_share_those_of_most_evidence():
    """Oracle: closed form: 0.9 against 0.4 + 0.3; an input that states its axes keeps them."""
    seen = replace(ONE, frame_source="evidence", frame="rub", frame_score=0.9, notes=())
    others = [replace(seen, frame="rdf", frame_score=score) for score in (0.4, 0.3)]
    stated = replace(ONE, frame="rfu", notes=())
    found = met(*others, seen, stated)
    assert found.frame == "rub"
    np.testing.assert_array_equal(found.maps[0], np.eye(4))
    assert not np.array_equal(found.maps[3], np.eye(4))
    assert "'rub' by most of the evidence, also for 2 that suggest others" in found.notes[0]


def test_the_degree_is_bounded():
    """Oracle: closed form: the highest of all, or less if asked for."""
    assert met(ONE, replace(ONE, degree=3)).degree == 3
    assert met(ONE, replace(ONE, degree=3), sh_degree=2).degree == 2


def test_inputs_that_cannot_meet_are_one_sentence():
    """Oracle: the sentences."""
    with pytest.raises(UsageError, match=r"b\.ply: found colours in lin_ap1_scene"):
        met(ONE, replace(ONE, name="b.ply", color_space="lin_ap1_scene"))
    with pytest.raises(UsageError, match=r"pixel: found 6\.1, expected 0 to 6, the size of"):
        met(ONE, pixel=6.1)
    with pytest.raises(StageError, match="found no splats"):
        met(replace(ONE, parts=(0,)))


def test_the_weighted_median_has_half_of_the_weight_before_it():
    """Oracle: closed form."""
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([1, 1, 1])
    assert weighted_median(values, weights) == 2.0
    assert weighted_median(values, np.array([5, 1, 1])) == 3.0


def test_hints_on_which_all_inputs_agree_are_those_of_the_tree():
    """Oracle: closed form; a footprint has the unit of the first input that states one."""
    modes = {"projection_modes": ("tangential",), "sorting_modes": ("rayHitDistance",)}
    first = replace(ONE, **modes, footprints=(0.02, 0.02), meters_per_unit=1.0)
    other = replace(first, footprints=(2.0, 2.0), meters_per_unit=0.01)
    found = met(first, other)
    assert found.drawing.footprint == pytest.approx(0.02, rel=1e-6)
    assert replace(found.drawing, footprint=0.02) == DrawingHints(
        rasterize_mode="classic",
        projection_mode="tangential",
        sorting_mode="rayHitDistance",
        footprint=0.02,
    )
    assert not [note for note in found.notes if "different" in note]
    assert met(replace(ONE, antialiased=True)).drawing.rasterize_mode == "antialiased"


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"projection_modes": ("tangential",)}, "different projection modes"),
        ({"sorting_modes": ("cameraDistance", "zDepth")}, "different sorting modes"),
        ({"footprints": (0.02, 0.02)}, "different footprints, or some have none"),
        ({"footprints": (0.0, 0.02)}, "different footprints, or some have none"),
    ],
)
def test_hints_that_differ_are_a_note(other, said):
    """Oracle: the note; the tree has no value of its own."""
    found = met(ONE, replace(ONE, **other))
    assert [said in note for note in found.notes].count(True) == 1
    (name,) = (each.rstrip("s") for each in other)
    assert getattr(found.drawing, name) is None
