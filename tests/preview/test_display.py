"""Tests of the display of each AOV. Oracle: closed forms."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.aovs import AOVS
from usdsplat.images.color import convert
from usdsplat.images.cryptomatte import hash_bits
from usdsplat.images.display_writer import quantized
from usdsplat.images.view import open_view
from usdsplat.kernels.devices import open_device
from usdsplat.preview.display import Display, choices, needed, settings_of
from usdsplat.preview.values import DisplaySettings, Look
from usdsplat.render.settings import RenderSettings

BLACK = DisplaySettings(background="black")
INF = np.float32(np.inf)


@pytest.fixture
def display():
    return Display(open_device())


def colors(seed=0, shape=(40, 60), most=1.2):
    """Premultiplied random colours, some over 1, some nothing, some opaque."""
    rng = np.random.default_rng(seed)
    alpha = rng.choice([0.0, 0.3, 0.8, 1.0], (*shape, 1))
    return np.concatenate([rng.uniform(0, most, (*shape, 3)) * alpha, alpha], -1).astype(np.float32)


def show(display, aov, array, how=BLACK, beside=None, **options):
    arrays = {AOVS[aov].hydra: array, **(beside or {})}
    return display.image(Look(aov=aov, settings=options.pop("settings", RenderSettings())),
                         arrays, how, **options)  # fmt: skip


def encode(linear):
    """IEC 61966-2-1."""
    linear = np.clip(linear, 0, None)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decode(code):
    code = np.clip(code, 0, None)
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def graded(image, grade):
    """Straight code values through a function, premultiplied again, as bytes."""
    alpha = image[..., 3:].astype(np.float64)
    straight = np.divide(image[..., :3], alpha, out=np.zeros(image[..., :3].shape), where=alpha > 0)
    return 255 * np.clip(np.clip(grade(straight), 0, 1) * alpha, 0, 1)


# --- colour ----------------------------------------------------------------------------


def test_shown_code_values_are_the_rendered_ones_rounded(display):
    """Oracle: NumPy's own rounding, in float32 as the picture is; over black, exactly."""
    image = colors()
    expected = (np.clip(image[..., :3] * np.float32(255), 0, 255) + np.float32(0.5)).astype(int)
    np.testing.assert_array_equal(show(display, "color", image), np.minimum(expected, 255))


def test_an_opaque_picture_is_what_png_holds(display):
    """Oracle: the PNG writer's quantisation."""
    image = colors()
    image[..., 3] = 1
    np.testing.assert_array_equal(
        show(display, "color", image, DisplaySettings()), quantized(image, np.uint8)[..., :3]
    )


@pytest.mark.parametrize("exposure", [-3.0, -0.5, 1.0, 4.0])
@pytest.mark.parametrize("gamma", [0.6, 1.0, 2.2])
def test_exposure_multiplies_light_and_gamma_comes_last(display, exposure, gamma):
    """Oracle: the curves of sRGB written out, in float64; within half a code value of rounding."""
    image = colors(most=1.0)
    found = show(display, "color", image, replace(BLACK, exposure=exposure, gamma=gamma))
    expected = graded(image, lambda c: encode(2**exposure * decode(c)).clip(0, 1) ** (1 / gamma))
    assert abs(found - expected).max() <= 0.55


def test_what_is_over_white_comes_back_with_less_exposure(display):
    """Oracle: closed form: twice white, one stop down, is white; at no exposure both clip."""
    two = float(encode(np.array(2.0)))
    image = np.full((1, 2, 4), (two, two, two, 1), np.float32)
    assert (show(display, "color", image) == 255).all()
    half = show(display, "color", image, replace(BLACK, exposure=-2))
    assert (half == round(255 * float(encode(np.array(0.5))))).all()


@pytest.mark.parametrize("mode", ["scene", "inverseView"])
@pytest.mark.parametrize("space", ["lin_rec709_scene", "lin_ap1_scene"])
def test_linear_pictures_go_through_the_plain_view(display, mode, space):
    """Oracle: the view transform that files are made with, in float32, and exposure in light."""
    settings = RenderSettings(color_mode=mode, working_space=space)
    image = colors(most=0.9)
    found = show(display, "color", image, replace(BLACK, exposure=0.7), settings=settings)
    view = open_view(working_space=space)
    lit = np.concatenate([image[..., :3] * np.float32(2**0.7), image[..., 3:]], -1)
    with np.errstate(invalid="ignore"):
        expected = graded(view.forward_over(lit), lambda code: code)
    assert abs(found - expected).max() <= 0.6


def test_linear_pictures_go_through_an_ocio_view_to_within_its_lattice(display):
    """Oracle: the view itself, by OpenImageIO: on average a third of a code value away, at worst
    three, half a code of both being the rounding."""
    options = {"ocio_config": "ocio://default"}
    settings = RenderSettings(color_mode="scene", **options)
    rng = np.random.default_rng(2)
    image = np.ones((64, 64, 4), np.float32)
    image[..., :3] = rng.lognormal(-1.5, 1.2, (64, 64, 1)) * rng.uniform(0.5, 1.5, (64, 64, 3))
    found = show(display, "color", image, settings=settings)
    expected = 255 * np.clip(open_view(config="ocio://default").forward(image[..., :3]), 0, 1)
    assert abs(found - expected).mean() < 0.35
    assert abs(found - expected).max() < 3.5


def test_a_display_picture_does_not_go_through_a_view_twice(display):
    """Oracle: the rounded code values: in display mode surfaces have been through the view."""
    image = colors()
    settings = RenderSettings(ocio_config="ocio://default")
    np.testing.assert_array_equal(
        show(display, "color", image, settings=settings), show(display, "color", image)
    )


@pytest.mark.parametrize("background, code", [("black", 0), ("grey", 56), ("white", 255)])
def test_pictures_lie_over_the_background_in_code_values(display, background, code):
    """Oracle: the over operator; where nothing is, the background is seen as it is."""
    image = colors()
    how = DisplaySettings(background=background, exposure=0)
    expected = 255 * image[..., :3] + (1 - image[..., 3:]) * (0.22 * 255 if code == 56 else code)
    found = show(display, "color", image, how)
    assert abs(found - np.clip(expected, 0, 255)).max() <= 0.51
    nothing = show(display, "color", np.zeros((2, 2, 4), np.float32), replace(how, exposure=5))
    assert (nothing == code).all()


def test_a_checker_keeps_its_size_on_the_screen(display):
    """Oracle: the picture at half the resolution is every second pixel of the full one."""
    how = DisplaySettings(background="checker")
    full = show(display, "color", np.zeros((96, 96, 4), np.float32), how)
    half = show(display, "color", np.zeros((48, 48, 4), np.float32), how, scale=2.0)
    assert len(np.unique(full)) == 2
    np.testing.assert_array_equal(full[::2, ::2], half)
    ids = show(display, "id", np.full((96, 96), -1, np.int32), how, prims=())
    np.testing.assert_array_equal(ids, full)


@pytest.mark.parametrize("channel, index", [("red", 0), ("green", 1), ("blue", 2), ("alpha", 3)])
def test_one_channel_is_grey(display, channel, index):
    """Oracle: that channel, rounded; the background has no part in it."""
    image = colors(most=1.0)
    found = show(display, "color", image, DisplaySettings(channel=channel))
    expected = (image[..., index] * np.float32(255) + np.float32(0.5)).astype(int)
    for c in range(3):
        np.testing.assert_array_equal(found[..., c], expected)


def test_luminance_is_of_light(display):
    """Oracle: Rec.709's weights of linear light, encoded."""
    image = colors(most=1.0)
    found = show(display, "color", image, replace(BLACK, channel="luminance"))
    shown = show(display, "color", image) / 255
    light = decode(shown) @ (0.2126390059, 0.7151686788, 0.0721923154)
    assert abs(found - 255 * encode(light)[..., None]).max() <= 0.6


def test_what_is_not_a_number_is_black(display):
    """Oracle: a person, who wants to see that something is wrong and no crash."""
    image = np.full((2, 2, 4), np.nan, np.float32)
    for how in (BLACK, replace(BLACK, exposure=1)):
        assert (show(display, "color", image, how) == 0).all()


def test_albedo_is_a_colour_with_the_alpha_of_color(display):
    """Oracle: the same numbers shown as color."""
    image = colors()
    beside = {"color": image}
    found = show(display, "albedo", image[..., :3].copy(), DisplaySettings(), beside)
    np.testing.assert_array_equal(found, show(display, "color", image, DisplaySettings()))


# --- data ------------------------------------------------------------------------------


def test_depths_are_white_to_black_in_their_range(display):
    """Oracle: a straight line from 2 to 10; nothing at infinity."""
    depths = np.array([[2, 4, 6, 10, 1, 99, INF]], np.float32)
    found = show(display, "Z", depths, DisplaySettings(depth_range=(2, 10)))
    np.testing.assert_array_equal(found[0, :, 0], (255, 191, 128, 0, 255, 0, 56))


def test_a_range_of_depths_is_found_without_strays(display):
    """Oracle: percentiles: of depths from 5 to 6 and one at 1000 the far ones are nearly black."""
    depths = np.linspace(5, 6, 10_000, dtype=np.float32).reshape(100, 100)
    depths[0, 0] = 1000
    found = show(display, "Z", depths)[..., 0]
    assert found[0, 0] == 0
    assert found[0, 1] > 250 and found[-1, -1] < 5 and abs(int(found[50, 0]) - 127) < 3


def test_ranges_stay_while_the_view_moves_and_are_right_when_it_rests(display):
    """Oracle: a fresh display, which has no memory."""
    depths = np.linspace(5, 6, 10_000, dtype=np.float32).reshape(100, 100)
    before = show(display, "Z", depths)
    nudged = depths + np.float32(0.1)
    moving = show(display, "Z", nudged, is_moving=True)
    steady = np.clip(before.astype(int) - 0.1 * 255 / 0.98, 0, 255)
    assert abs(moving - steady)[10:80].max() <= 2
    fresh = show(Display(open_device()), "Z", nudged)
    np.testing.assert_array_equal(show(display, "Z", nudged), fresh)


def test_a_jump_while_the_view_moves_does_not_leave_the_range_behind(display):
    """Oracle: a person, who still wants to see something when depths are all others."""
    depths = np.linspace(5, 6, 10_000, dtype=np.float32).reshape(100, 100)
    show(display, "Z", depths)
    assert np.ptp(show(display, "Z", 20 * depths, is_moving=True)) > 200


def test_turbo_is_red_near_and_blue_far(display):
    """Oracle: a person: warm is near, cold is far, and the middle is green."""
    depths = np.array([[0.1, 0.5, 0.75]], np.float32)
    how = DisplaySettings(depth_range=(0, 1), colormap="turbo")
    near, middle, far = show(display, "Z", depths, how)[0]
    assert (near.argmax(), middle.argmax(), far.argmax()) == (0, 1, 2)


def test_normals_are_half_and_half_of_a_unit(display):
    """Oracle: -1, 0 and 1 are 0, 128 and 255; no normal is the background."""
    normals = np.array([[(-1, 0, 1), (0, 0, 0)]], np.float32)
    found = show(display, "N", normals, DisplaySettings())
    np.testing.assert_array_equal(found, [[(0, 128, 255), (56, 56, 56)]])


def test_positions_are_measured_from_corner_to_corner_of_the_subject(display):
    """Oracle: a straight line on each axis."""
    subject = np.array([-1.0, 0.0, 10.0]), np.array([1.0, 4.0, 20.0])
    positions = np.array([[(-1, 4, 15), (5, 1, 10)]], np.float32)
    found = show(display, "P", positions, subject=subject)
    np.testing.assert_array_equal(found, [[(0, 255, 128), (255, 64, 0)]])


def test_motion_has_the_hue_of_its_direction_and_the_value_of_its_length(display):
    """Oracle: the colour wheel: right is red, up yellow-green, left cyan; nothing moves black,
    and nothing at all is the background."""
    motion = np.zeros((1, 5, 2), np.float32)
    motion[0, :3] = (8, 0), (0, 4), (-8, 0)
    depth = np.array([[1, 1, 1, 1, INF]], np.float32)
    how = DisplaySettings()
    right, up, left, still, nothing = show(display, "forward", motion, how, {"depth": depth})[0]
    np.testing.assert_array_equal(right, (255, 0, 0))
    np.testing.assert_array_equal(left, (0, 255, 255))
    assert up[1] > up[0] > up[2] == 0 and abs(int(up[1]) - 128) <= 2
    assert still.max() == 0 and nothing.max() == 56


def test_noise_of_motion_is_not_blown_up(display):
    """Oracle: a person: a thousandth of a pixel is no motion."""
    motion = np.full((4, 4, 2), 1e-3, np.float32)
    depth = np.ones((4, 4), np.float32)
    assert show(display, "backward", motion, BLACK, {"depth": depth}).max() <= 1


def test_ids_have_steady_colours_and_prims_those_of_their_names(display):
    """Oracle: equal numbers, and equal paths whatever their number, have equal colours; others
    have others."""
    ids = np.array([[0, 1, 2, 0, -1]], np.int32)
    found = show(display, "splatId", ids)[0]
    assert len({tuple(each) for each in found.tolist()}) == 4
    np.testing.assert_array_equal(found[0], found[3])
    assert found[4].max() == 0
    first = show(display, "id", ids, prims=("/A", "/B", "/C"))[0]
    second = show(display, "id", ids, prims=("/B", "/C", "/D"))[0]
    np.testing.assert_array_equal(first[1:3], second[0:2])


def test_a_matte_has_the_colours_of_its_prims_by_their_coverage(display):
    """Oracle: the over operator with the colours that the AOV id has."""
    paths = ("/World/A", "/World/B")
    hashes = [struct.unpack("<f", struct.pack("<I", hash_bits(path)))[0] for path in paths]
    matte = np.zeros((1, 2, 12), np.float32)
    matte[0, 0, :4] = hashes[0], 0.5, hashes[1], 0.25
    ids = show(display, "id", np.array([[0, 1]], np.int32), prims=paths)[0].astype(float)
    found = show(display, "cryptoObject", matte, DisplaySettings(background="white"))
    expected = 0.5 * ids[0] + 0.25 * ids[1] + 0.25 * 255
    assert abs(found[0, 0] - expected).max() <= 0.51
    assert (found[0, 1] == 255).all()


@pytest.mark.parametrize("aov", ["confidence", "occlusion"])
def test_fractions_go_from_one_end_of_the_ramp_to_the_other(display, aov):
    """Oracle: black, the middle and white."""
    values = {aov: np.float32([[0, 0.5, 1]]), "depth": np.ones((1, 3), np.float32)}
    found = display.image(Look(aov=aov), values, DisplaySettings(colormap="grey"))
    assert (found[0, 0] == 0).all()
    assert (abs(found[0, 1].astype(int) - 127) <= 1).all()
    assert (found[0, 2] == 255).all()


@pytest.mark.parametrize("aov", ["irradiance", "light_key"])
def test_light_is_shown_as_linear_colour(display, aov):
    """Oracle: the sRGB curve of linear light, whatever the color mode of the look; light on half
    covered pixels lies over the background by half."""
    light, half = np.full((1, 2, 3), 0.25, np.float32), np.float32([[1.0, 0.5]])[..., None]
    color = np.concatenate([light, half], axis=-1)
    arrays = {aov: light if aov == "irradiance" else light * half, "color": color}
    assert needed(Look(aov=aov)) == (aov, "color")
    found = display.image(Look(aov=aov), arrays, DisplaySettings(background="black"))
    code = convert(np.full((1, 3), 0.25), "lin_rec709_scene", "srgb_rec709_display")
    expected = np.concatenate([code, 0.5 * code])
    assert np.abs(found[0] - 255 * expected).max() <= 1.0
    settings = settings_of(Look(aov=aov, settings=RenderSettings(color_mode="display")))
    assert (settings.blend_space, settings.color_mode) == ("linear", "scene")


def test_light_groups_of_the_stage_can_be_chosen():
    """Oracle: the table, and the names that follow it."""
    names = [aov.name for aov in choices(("light_key", "light_captured"))]
    assert names == [*AOVS, "light_key", "light_captured"]


@pytest.mark.parametrize("aov", [*AOVS, "light_key"])
def test_every_aov_can_be_shown_where_nothing_is(display, aov):
    """Oracle: the background, whatever is asked for."""
    nothing = {
        "color": np.zeros((3, 4, 4)), "albedo": np.zeros((3, 4, 3)), "depth": np.full((3, 4), INF),
        "depthFront": np.full((3, 4), INF), "depthExpected": np.full((3, 4), INF),
        "Neye": np.zeros((3, 4, 3)), "Naxis": np.zeros((3, 4, 3)), "confidence": np.zeros((3, 4)),
        "occlusion": np.zeros((3, 4)), "shadow": np.ones((3, 4, 3)),
        "irradiance": np.zeros((3, 4, 3)), "light_key": np.zeros((3, 4, 3)),
        "P": np.zeros((3, 4, 3)),
        "cryptoObject": np.zeros((3, 4, 12)),
        "cryptoAsset": np.zeros((3, 4, 4)), "cryptoMaterial": np.zeros((3, 4, 32)),
        "motionForward": np.zeros((3, 4, 2)), "motionBackward": np.zeros((3, 4, 2)),
    }  # fmt: skip
    arrays = {
        name: nothing[name].astype(np.float32) if name in nothing else np.full((3, 4), -1, np.int32)
        for name in needed(Look(aov=aov))
    }
    found = display.image(Look(aov=aov), arrays, DisplaySettings(background="white"))
    assert found.shape == (3, 4, 3) and (found == 255).all()


def test_an_aov_that_there_is_not_is_named(display):
    """Oracle: the error says which ones there are."""
    with pytest.raises(UsageError, match="'beauty'"):
        needed(Look(aov="beauty"))
