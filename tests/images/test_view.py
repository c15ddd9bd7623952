"""Tests of OCIO views, forward and inverse."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.color import convert
from usdsplat.images.science import colour_science
from usdsplat.images.view import ViewTransform, open_view

STUDIO = "ocio://studio-config-latest"
ACES = "ACES 2.0 - SDR 100 nits (Rec.709)"
GAMUT = "ACES 1.3 Reference Gamut Compression"
SWATCHES = np.array(
    [[[0.18, 0.5, 0.9], [0.1, 0.9, 0.05]], [[0.02, 0.02, 0.02], [0.95, 0.9, 0.85]]], np.float32
)
CONFIG = """ocio_profile_version: 2
roles: {scene_linear: lin, default: raw}
displays:
  Monitor:
    - !<View> {name: Power, colorspace: pow}
    - !<View> {name: Half, colorspace: half}
colorspaces:
  - !<ColorSpace> {name: lin, aliases: [ACEScg]}
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace>
    name: pow
    from_scene_reference: !<ExponentTransform> {value: 2, direction: inverse}
  - !<ColorSpace>
    name: half
    from_scene_reference: !<RangeTransform>
      {min_in_value: 0, max_in_value: 0.5, min_out_value: 0, max_out_value: 0.5}
"""


@pytest.fixture
def config(tmp_path) -> str:
    """A config whose views are a square root, and a clamp at one half."""
    path = tmp_path / "small.ocio"
    path.write_text(CONFIG)
    return str(path)


def named(working_space="lin_ap1_scene", **names) -> ViewTransform:
    """A view of the built-in studio config."""
    return open_view(**{"config": STUDIO, "working_space": working_space, **names})


def test_without_any_name_a_view_is_plain_srgb(monkeypatch, config) -> None:
    """$OCIO alone does not count. Oracle: `images.color.convert`, tested against Gf."""
    monkeypatch.setenv("OCIO", config)
    view = open_view(working_space="lin_ap1_scene")
    assert view.is_plain
    np.testing.assert_allclose(
        view.forward(SWATCHES),
        convert(SWATCHES, "lin_ap1_scene", "srgb_rec709_scene"),
        atol=1e-6,
    )
    linear, failed = view.inverse(SWATCHES, most=100.0)
    np.testing.assert_allclose(view.forward(linear), SWATCHES, atol=1e-6)
    assert not failed.any()


@pytest.mark.parametrize("space", ["lin_rec709_scene", "lin_ap1_scene", "lin_p3d65_scene"])
def test_a_colorimetric_view_is_the_plain_one(space) -> None:
    """Only that view clamps. Oracle: our own curve and matrices, which know no OCIO."""
    ocio = named(space, view="Video (colorimetric)")
    assert not ocio.is_plain
    plain = open_view(working_space=space)
    linear, failed = ocio.inverse(SWATCHES, most=100.0)
    assert not failed.any()
    np.testing.assert_allclose(linear, plain.inverse(SWATCHES, most=100.0)[0], atol=2e-4)
    np.testing.assert_allclose(ocio.forward(linear), plain.forward(linear), atol=2e-4)


def test_a_view_by_a_power_is_that_power(config) -> None:
    """A config without our names is asked by its aliases. Oracle: the square root, closed form."""
    view = open_view(config=config, working_space="lin_ap1_scene")
    assert (view.display, view.view, view.source) == ("Monitor", "Power", "lin")
    np.testing.assert_allclose(view.forward(SWATCHES), np.sqrt(SWATCHES), rtol=1e-4)
    linear, failed = view.inverse(SWATCHES, most=100.0)
    np.testing.assert_allclose(linear, SWATCHES**2, rtol=1e-4)
    assert not failed.any()


def test_the_environment_names_the_config(monkeypatch, config) -> None:
    """Oracle: the only config that has this view."""
    monkeypatch.setenv("OCIO", config)
    assert open_view(view="Power", working_space="lin_ap1_scene").config == config


@pytest.mark.parametrize("look", ["", GAMUT])
def test_a_view_is_what_ocio_says(look: str) -> None:
    """Oracle: OCIO's own binding, forward again."""
    ocio = pytest.importorskip("PyOpenColorIO")
    view = ocio.LegacyViewingPipeline()
    view.setDisplayViewTransform(ocio.DisplayViewTransform("ACEScg", "sRGB - Display", ACES))
    if look:
        view.setLooksOverrideEnabled(True)
        view.setLooksOverride(look)
    config = ocio.Config.CreateFromFile(STUDIO)
    forward = view.getProcessor(config).getDefaultCPUProcessor()
    linear, _ = named(look=look).inverse(SWATCHES, most=65504.0)
    shown = linear.copy()
    forward.applyRGB(shown)
    np.testing.assert_allclose(shown, SWATCHES, atol=5e-4)


def test_aces_comes_back_and_white_is_128() -> None:
    """Oracle: the round trip itself; ACES 2.0's own statement of where display white lies."""
    view = named()
    assert view.view == ACES
    linear, failed = view.inverse(SWATCHES, most=65504.0)
    assert not failed.any()
    np.testing.assert_allclose(view.forward(linear), SWATCHES, atol=5e-4)
    white, failed = view.inverse(np.ones((1, 1, 3), np.float32), most=65504.0)
    np.testing.assert_allclose(white, 128.0, rtol=1e-4)
    assert not failed.any()


def test_a_clamp_fails_the_pixels_that_it_changes() -> None:
    """Oracle: the display white that takes 128 cannot be reached with 8; mid grey takes 0.37."""
    grey_and_white = np.array([[[0.5] * 3, [1.0] * 3]], np.float32)
    linear, failed = named().inverse(grey_and_white, most=8.0)
    assert linear.max() == 8.0
    assert failed.tolist() == [[False, True]]


def test_values_that_no_display_shows_fail() -> None:
    """Oracle: a code value above 1 or below 0 is never shown."""
    beyond = np.array([[[1.2, 0.5, 0.5], [0.5, -0.1, 0.5], [0.5, 0.5, np.nan]]], np.float32)
    assert named().inverse(beyond, most=65504.0)[1].all()


def test_a_look_is_undone_with_its_view() -> None:
    """Oracle: the round trip with the look; without it the picture is another one."""
    with_look, without = named(look=GAMUT), named()
    saturated = np.array([[[0.92, 0.02, 0.02], [0.05, 0.9, 0.05]]], np.float32)
    linear, failed = with_look.inverse(saturated, most=65504.0)
    assert not failed.any()
    np.testing.assert_allclose(with_look.forward(linear), saturated, atol=5e-4)
    assert np.abs(without.forward(linear) - saturated).max() > 0.01


def test_another_display_shows_the_same_light() -> None:
    """Half of sRGB's scale keeps its luminance. Oracle: ST 2084, by colour-science, at 100 nits."""
    view = named(display="Rec.2100-PQ - Display", view="Video (colorimetric)")
    grey = np.full((1, 1, 3), 0.5, np.float32)
    linear, failed = view.inverse(grey, most=65504.0)
    assert not failed.any()
    colour = colour_science()
    nits = 100.0 * colour.models.eotf_sRGB(0.5)
    expected = colour.models.eotf_inverse_ST2084(nits)
    np.testing.assert_allclose(view.forward(linear), expected, atol=1e-3)


def test_a_view_of_data_shows_what_it_is_given() -> None:
    """Oracle: identity."""
    view = named(view="Raw")
    linear, failed = view.inverse(SWATCHES, most=10.0)
    np.testing.assert_array_equal(linear, SWATCHES)
    assert not failed.any()


def test_premultiplied_pictures_are_converted_by_their_straight_colours() -> None:
    """Oracle: the straight colours, converted; what has no alpha stays and does not fail."""
    view = named()
    alpha = np.array([[1.0, 0.25], [0.0, 0.5]], np.float32)[..., None]
    image = np.concatenate([SWATCHES * alpha, alpha], axis=2)
    image[1, 0, :3] = 0.3
    linear, failed = view.inverse_over(image, most=65504.0)
    expected, _ = view.inverse(SWATCHES, most=65504.0)
    assert not failed.any()
    np.testing.assert_array_equal(linear[..., 3:], alpha)
    np.testing.assert_array_equal(linear[1, 0], image[1, 0])
    covered = alpha[..., 0] > 0
    np.testing.assert_allclose(linear[covered, :3], (expected * alpha)[covered], rtol=1e-4)
    np.testing.assert_allclose(view.forward_over(linear), image, atol=5e-4)
    _, failed = view.inverse_over(image, most=0.01)
    assert failed.tolist() == [[True, True], [False, True]]


def test_a_picture_without_cover_stays() -> None:
    """Oracle: identity."""
    empty = np.zeros((2, 3, 4), np.float32)
    image, failed = named().inverse_over(empty, most=1.0)
    np.testing.assert_array_equal(image, empty)
    assert not failed.any()


def test_bands_and_threads_agree_with_the_whole() -> None:
    """Oracle: one call for the whole picture."""
    view = named()
    code = np.random.default_rng(1).random((12, 40, 3)).astype(np.float32)
    whole, _ = view.inverse(code, most=65504.0)
    found: dict[int, np.ndarray] = {}

    def draw(y: int) -> None:
        found[y] = view.inverse(code[y : y + 4], most=65504.0)[0]

    threads = [threading.Thread(target=draw, args=(y,)) for y in (0, 4, 8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(np.concatenate([found[y] for y in (0, 4, 8)]), whole)


@pytest.mark.parametrize(
    ("names", "where", "expected"),
    [
        ({"config": "nowhere.ocio"}, "ocio_config", "OCIO can read"),
        ({"display": "Teapot"}, "ocio_display", "sRGB - Display"),
        ({"view": "Teapot"}, "ocio_view", ACES),
        ({"look": "Teapot"}, "ocio_look", GAMUT),
    ],
)
def test_a_name_that_does_not_exist_is_answered_with_those_that_do(names, where, expected) -> None:
    """Oracle: the names in the config."""
    with pytest.raises(UsageError) as caught:
        named(**names)
    assert caught.value.where == where
    assert expected in caught.value.expected


def test_a_config_without_the_working_space_is_refused(config) -> None:
    """Oracle: the config's four spaces."""
    with pytest.raises(UsageError, match=r"working_space: found .*, which .* does not have"):
        open_view(config=config, working_space="lin_rec2020_scene")


def test_a_view_that_cannot_be_inverted_says_so_or_fails_its_pixels(config) -> None:
    """Oracle: a clamp at one half loses what is above it."""
    view = open_view(config=config, view="Half", working_space="lin_ap1_scene")
    _, failed = view.inverse(np.array([[[0.3] * 3, [0.8] * 3]], np.float32), most=10.0)
    assert failed.tolist() == [[False, True]]
