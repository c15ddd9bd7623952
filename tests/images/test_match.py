"""Tests of fitting grades to colours."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.core.grade import UNIT, Grade
from usdsplat.images.color import convert
from usdsplat.images.grade import grade_matrix
from usdsplat.images.match import PARTS, apply_grade, fit_grade, in_primaries
from usdsplat.images.science import chart, colour_science, delta_e

RNG = np.random.default_rng(7)
COLORS = np.exp(RNG.normal(-1.5, 0.8, (400, 3)))
CHART = np.array(list(chart("classic24").values()))
MATRIX = (0.9, 0.12, -0.02, 0.03, 1.02, -0.05, 0.01, -0.08, 1.1)


def total(grade: Grade) -> np.ndarray:
    """The 3x3 of a grade."""
    return np.reshape(grade_matrix(grade, "lin_rec709_scene"), (3, 3))


@pytest.mark.parametrize("colors", [COLORS, CHART], ids=["pixels", "chart"])
@pytest.mark.parametrize(
    "grade",
    [
        Grade(),
        Grade(exposure=-1.3),
        Grade(exposure=0.7, temperature=3200.0, tint=0.01),
        Grade(exposure=0.2, temperature=4400.0),
        Grade(exposure=2.5, temperature=11000.0, tint=-0.015),
    ],
)
def test_exposure_and_white_balance_are_recovered(colors: np.ndarray, grade: Grade) -> None:
    """Oracle: the grade that made the colours."""
    fit = fit_grade(colors, apply_grade(colors, grade), parts=("exposure", "whiteBalance"))
    assert fit.used == len(colors)
    assert abs(fit.grade.exposure - grade.exposure) < 1e-3
    assert abs(fit.grade.temperature / grade.temperature - 1) < 1e-3
    assert abs(fit.grade.tint - grade.tint) < 1e-5
    assert fit.grade.matrix == UNIT


@pytest.mark.parametrize("colors", [COLORS, CHART], ids=["pixels", "chart"])
def test_all_together_are_recovered_as_one_matrix(colors: np.ndarray) -> None:
    """How the parts share it is the fit's choice. Oracle: the 3x3 that made the colours."""
    grade = Grade(exposure=0.6, temperature=4100.0, tint=-0.004, matrix=MATRIX)
    fit = fit_grade(colors, apply_grade(colors, grade))
    np.testing.assert_allclose(total(fit.grade), total(grade), atol=1e-3)
    assert fit.notes == ()


def test_a_part_that_may_not_change_stays_neutral() -> None:
    """Oracle: the defaults of the grade; for exposure alone the closed form of a scale."""
    wanted = apply_grade(COLORS, Grade(exposure=1.5))
    assert fit_grade(COLORS, wanted, parts=("exposure",)).grade.exposure == pytest.approx(1.5)
    balance = fit_grade(COLORS, wanted, parts=("whiteBalance",)).grade
    assert (balance.exposure, balance.matrix) == (0.0, UNIT)
    matrix = fit_grade(COLORS, wanted, parts=("matrix",)).grade
    assert (matrix.exposure, matrix.temperature) == (0.0, 6504.0)
    np.testing.assert_allclose(np.reshape(matrix.matrix, (3, 3)), 2**1.5 * np.eye(3), atol=1e-6)


@pytest.mark.parametrize("part", [0.0, 0.1, 0.25])
def test_what_is_in_one_picture_only_does_not_count(part: float) -> None:
    """Oracle: the grade that made the others, among noise of 1 %."""
    rng = np.random.default_rng(11)
    colors = np.exp(rng.normal(-1.5, 0.8, (3000, 3)))
    grade = Grade(exposure=-0.8, temperature=5000.0, matrix=MATRIX)
    wanted = apply_grade(colors, grade) * rng.normal(1.0, 0.01, colors.shape)
    strange = rng.random(len(colors)) < part
    wanted[strange] = rng.uniform(0.0, 4.0, (strange.sum(), 3)) * (3.0, 0.2, 0.1)
    fit = fit_grade(colors, wanted)
    np.testing.assert_allclose(total(fit.grade), total(grade), atol=4e-3)
    assert fit.used <= len(colors) - 0.9 * strange.sum()
    assert fit.used > 0.8 * (~strange).sum()


def test_greys_tell_no_matrix() -> None:
    """Oracle: a rank of one; exposure is found all the same."""
    greys = np.linspace(0.05, 0.9, 50)[:, None] * np.ones(3)
    fit = fit_grade(greys, 2 * greys)
    assert fit.grade.matrix == UNIT
    assert fit.notes[0].startswith("matrix not fitted: the colours are too similar")
    assert fit.grade.exposure == pytest.approx(1.0, abs=1e-6)
    assert fit.grade.temperature == pytest.approx(6504.0, rel=1e-4)


def test_few_colours_tell_no_matrix() -> None:
    """Oracle: the note."""
    fit = fit_grade(COLORS[:4], COLORS[:4])
    assert fit.notes == ("matrix not fitted: 4 colours, at least 6 needed",)


@pytest.mark.parametrize("space", ["srgb_rec709_scene", "lin_ap1_scene", "srgb_p3d65_scene", "raw"])
def test_other_primaries_get_another_matrix_for_the_same_look(space: str) -> None:
    """Oracle: grade in Rec.709, against convert, grade there, convert back."""
    grade = Grade(exposure=0.3, temperature=5000.0, tint=0.003, matrix=MATRIX)
    linear = {"srgb_rec709_scene": "lin_rec709_scene", "srgb_p3d65_scene": "lin_p3d65_scene"}
    there = linear.get(space, space)
    colors = convert(COLORS, "lin_rec709_scene", there)
    matrix = np.reshape(grade_matrix(in_primaries(grade, space), space), (3, 3))
    back = convert(colors @ matrix.T, there, "lin_rec709_scene")
    np.testing.assert_allclose(back, apply_grade(COLORS, grade), rtol=1e-6, atol=1e-9)


def test_nothing_to_fit_to_is_refused() -> None:
    """Oracle: the sentences."""
    with pytest.raises(UsageError, match="found no colours"):
        fit_grade(np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(UsageError, match="--fit: found 'gamma', expected one of exposure, white"):
        fit_grade(COLORS, COLORS, parts=("gamma",))
    assert PARTS == ("exposure", "whiteBalance", "matrix")


def test_the_chart_is_that_of_colour_science() -> None:
    """Oracle: colour-science's own way from xyY to linear Rec.709, by Bradford."""
    colour = colour_science()
    data = colour.CCS_COLOURCHECKERS["ColorChecker24 - After November 2014"]
    for name, found in chart("classic24").items():
        expected = colour.XYZ_to_RGB(
            colour.xyY_to_XYZ(data.data[name]),
            "sRGB",
            data.illuminant,
            chromatic_adaptation_transform="Bradford",
        )
        np.testing.assert_allclose(found, expected, atol=5e-4)
    with pytest.raises(UsageError, match=r"expected one of classic24, .*ColorChecker 2005"):
        chart("teapot")


def test_the_difference_is_ciede2000() -> None:
    """Oracle: equal is 0; black and white are 100 apart by definition of L*."""
    assert delta_e((0.2, 0.3, 0.4), (0.2, 0.3, 0.4)) == 0.0
    np.testing.assert_allclose(delta_e((0, 0, 0), (1, 1, 1)), 100.0, atol=0.01)
    assert delta_e(np.zeros((2, 5, 3)), np.ones((2, 5, 3))).shape == (2, 5)


def test_colour_science_leaves_no_trace_of_what_it_misses() -> None:
    """Numba can be imported after it, and nothing is printed. Oracle: a fresh process."""
    code = (
        "from usdsplat.images.science import delta_e\ndelta_e((0, 0, 0), (1, 1, 1))\nimport numba"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
