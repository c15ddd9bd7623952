"""Tests of edits in their order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.formats.samples import random_cloud
from tests.interchange.samples import assert_same, covariances
from usdsplat.core import sh
from usdsplat.core.edits import Edit, parsed
from usdsplat.core.errors import UsageError
from usdsplat.interchange.decimating import decimate, framing_pixel
from usdsplat.interchange.editing import bounds_after, edited, matrix_of

CLOUD = random_cloud(200, 2)


def after(*typed: str):
    """The cloud after edits as they are typed, without their dashes."""
    edits = [parsed(*(text.split(" ") if " " in text else (text, ""))) for text in typed]
    return edited(CLOUD, edits)[0]


def test_a_rotation_is_about_x_then_y_then_z() -> None:
    """Oracle: the three matrices of a textbook, multiplied; right angles by hand."""
    a, b, c = np.radians((20, 30, 40))
    x = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    y = [[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]
    z = [[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]]
    found = matrix_of(Edit(name="rotate", values=(20, 30, 40)))[:3, :3]
    np.testing.assert_allclose(found, np.array(z) @ y @ x, atol=1e-15)
    quarter = matrix_of(Edit(name="rotate", values=(90, 0, -450)))[:3, :3]
    np.testing.assert_array_equal(quarter @ (1, 2, 3), (-3, -1, 2))


def test_maps_act_in_the_order_in_which_they_stand() -> None:
    """Oracle: the two orders by hand, which differ."""
    first = after("translate 1,0,0", "scale 2")
    then = after("scale 2", "translate 1,0,0")
    np.testing.assert_allclose(
        first.positions, 2 * (CLOUD.positions + np.float32([1, 0, 0])), atol=1e-6
    )
    np.testing.assert_allclose(then.positions, 2 * CLOUD.positions + (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(first.scales, 2 * CLOUD.scales, rtol=1e-6)


def test_filters_and_maps_act_in_the_order_in_which_they_stand() -> None:
    """Oracle: rows picked by hand, before and after the move."""
    box = "crop-box 0,-9,-9,9,9,9"
    x = CLOUD.positions[:, 0]
    kept = CLOUD.positions[x >= 0]
    np.testing.assert_allclose(
        after(box, "translate -1,0,0").positions, kept - (1, 0, 0), atol=1e-6
    )
    kept = CLOUD.positions[x >= 1]
    np.testing.assert_allclose(
        after("translate -1,0,0", box).positions, kept - (1, 0, 0), atol=1e-6
    )


def test_covariances_and_colours_turn_with_the_centres() -> None:
    """Oracle: R S R^T, and the colour seen from a direction that turns too."""
    found = after("rotate 10,20,30", "scale 3")
    turn = matrix_of(Edit(name="rotate", values=(10, 20, 30)))[:3, :3]
    expected = 9 * turn @ covariances(CLOUD) @ turn.T
    np.testing.assert_allclose(covariances(found), expected, rtol=1e-4, atol=1e-5)
    direction = np.float32([[0.6, 0, 0.8]]).repeat(len(CLOUD), axis=0)
    seen = sh.evaluate(found.sh, (direction @ turn.T).astype(np.float32))
    np.testing.assert_allclose(seen, sh.evaluate(CLOUD.sh, direction), atol=1e-4)


SIZES = CLOUD.scales.max(axis=1)
FAR = np.linalg.norm(CLOUD.positions - (0.5, 0, 0), axis=1)


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        ("crop-sphere 0.5,0,0,1", FAR <= 1),
        ("min-opacity 0.3", CLOUD.opacities >= 0.3),
        ("max-opacity 0.3", CLOUD.opacities <= 0.3),
        ("min-size 0.05", SIZES >= 0.05),
        ("max-size 0.05", SIZES <= 0.05),
    ],
)
def test_filters_keep_the_rows_that_they_say(typed, kept) -> None:
    """Oracle: a mask, written out; some splats stay and some go."""
    assert 0 < kept.sum() < len(CLOUD)
    np.testing.assert_array_equal(after(typed).positions, CLOUD.positions[kept])
    assert edited(CLOUD, [parsed(*typed.split(" "))])[1] == (
        f"{typed}: {kept.sum()} splats of 200 left",
    )


def test_harmonics_are_cut_and_never_padded() -> None:
    """Oracle: the first coefficients; a higher degree changes nothing."""
    np.testing.assert_array_equal(after("sh-degree 1").sh, CLOUD.sh[:, :4])
    assert_same(after("sh-degree 3"), CLOUD)


def test_z_order_is_the_same_splats_closer_together() -> None:
    """Oracle: the sorted rows are equal, and steps from row to row are shorter."""
    found = after("morton").positions
    np.testing.assert_array_equal(np.sort(found, axis=0), np.sort(CLOUD.positions, axis=0))
    steps = [np.linalg.norm(np.diff(p, axis=0), axis=1).mean() for p in (found, CLOUD.positions)]
    assert steps[0] < 0.6 * steps[1]


def test_splats_that_are_not_finite_can_be_dropped() -> None:
    """Oracle: one number of each kind that is not, in three rows."""
    positions, harmonics = CLOUD.positions.copy(), CLOUD.sh.copy()
    positions[3, 1], positions[7, 0], harmonics[9, 1, 2] = np.nan, np.inf, -np.inf
    bad = replace(CLOUD, positions=positions, sh=harmonics)
    found = edited(bad, [Edit(name="drop-nan")])[0]
    np.testing.assert_array_equal(found.positions, np.delete(CLOUD.positions, (3, 7, 9), axis=0))


@pytest.mark.parametrize(("typed", "count"), [("30", 30), ("25%", 50)])
def test_a_cloud_is_decimated_to_a_count_or_a_share(typed, count) -> None:
    """Oracle: the number asked for, of 200."""
    assert len(after(f"decimate {typed}")) == count


def test_classic_splats_are_decimated_as_their_pictures_show_them() -> None:
    """Oracle: decimation at the framing pixel, and without one for an antialiased capture."""
    for antialiased, pixel in ((False, framing_pixel(CLOUD)), (True, 0.0)):
        steps = [parsed("decimate", "50")]
        found, _ = edited(CLOUD, steps, antialiased=antialiased)
        assert_same(found, decimate(CLOUD, 50, pixel=pixel))
    assert framing_pixel(CLOUD) > 0


def test_floaters_go() -> None:
    """Oracle: one splat moved far away from all others, by hand."""
    positions = CLOUD.positions.copy()
    positions[11] = 1000
    cloud = replace(CLOUD, positions=positions)
    found = edited(cloud, [parsed("drop-outliers", "20,2")])[0]
    np.testing.assert_array_equal(found.positions, np.delete(positions, 11, axis=0))


def test_an_edit_that_leaves_nothing_is_named() -> None:
    """Oracle: the documented error; allowed where it is asked for."""
    edits = [parsed("scale", "2"), parsed("min-size", "1e9"), parsed("morton", "")]
    with pytest.raises(UsageError, match=r"^edit min-size: found no splat left, expected some of"):
        edited(CLOUD, edits)
    assert len(edited(CLOUD, edits, may_empty=True)[0]) == 0


@pytest.mark.parametrize("typed", [("scale 1e39",), ("scale 1e308", "scale 1e308")])
def test_an_edit_that_leaves_float32_is_named(typed) -> None:
    """Oracle: the largest float32, 3.4e38."""
    with pytest.raises(UsageError, match=r"^edit scale: found splats beyond the float32 range"):
        after(*typed)
    assert after("scale 1e37", "scale 1e-37").positions == pytest.approx(CLOUD.positions, rel=1e-6)


def test_bounds_say_what_multiplies_or_mixes_them() -> None:
    """Oracle: centres grow with a scale, harmonics mix in a turn, opacities stay."""
    bounds = {"positions": "0.1", "opacities": "1/255", "sh": "4 %"}
    edits = [parsed("rotate", "0,0,9"), parsed("scale", "2"), parsed("translate", "1,1,1")]
    assert bounds_after(bounds, edits) == {
        "positions": "0.1, before rotate 0,0,9 and scale 2",
        "opacities": "1/255",
        "sh": "4 %, before rotate 0,0,9",
    }
    after_merging = bounds_after(bounds, [parsed("decimate", "50%")])
    assert set(after_merging) == {"positions", "scales", "rotations", "opacities", "sh"}
    assert after_merging["sh"] == "4 %, before decimate 50%"
    assert after_merging["scales"] == "unbounded: splats were merged by decimate 50%"
