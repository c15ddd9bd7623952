"""Tests of output colours: views, baked views, `inverseView`, and colour spaces in headers."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.cli.test_render import SMALL, header, read
from usdsplat.images.view import open_view

pytestmark = pytest.mark.usefixtures("compiled")

CONFIG = "ocio://cg-config-v2.1.0_aces-v1.3_ocio-v2.3"
ACES = ("--config", CONFIG)
REC1886 = ("--display", "Rec.1886 Rec.709 - Display")


@pytest.fixture
def drawn(run, shot, tmp_path):
    """Draw the first frame with flags; returns its pixels, header and stderr."""

    def draw(name, *flags):
        status, _, err = run("render", shot, "-o", tmp_path / name, "--frames", 1, *SMALL, *flags)
        assert status == 0, err
        kind = "uint8" if name.endswith(".png") else "float"
        return read(tmp_path / name, kind=kind), header(tmp_path / name), err

    return draw


def label(spec):
    return spec.getattribute("colorInteropID")


@pytest.mark.parametrize("space", ["lin_rec709_scene", "lin_ap1_scene"])
@pytest.mark.parametrize("mode", ["scene", "inverseView"])
def test_exrs_are_linear_in_the_working_space_and_say_so(drawn, mode, space):
    """Oracle: the flag."""
    _, spec, _ = drawn("a.exr", "--color-mode", mode, "--working-space", space)
    assert label(spec) == space


def test_a_png_of_a_scene_picture_goes_through_the_view(drawn):
    """Oracle: the linear EXR through `ViewTransform`, straight, in 255 steps."""
    linear, _, _ = drawn("a.exr", "--float")
    png, _, _ = drawn("a.png", "--color-mode", "scene", *ACES)
    expected = open_view(config=CONFIG).forward_over(linear)
    straight = expected[..., :3] / np.maximum(expected[..., 3:], 1e-9)
    codes = np.clip(np.concatenate([straight, expected[..., 3:]], axis=2), 0, 1) * 255
    assert np.abs(png - codes).max() <= 0.51


@pytest.mark.parametrize("flags", [ACES, (*ACES, *REC1886), ("--bake-view", *ACES)])
def test_a_png_goes_through_a_view_that_is_named(drawn, flags):
    """Oracle: the picture in colour mode scene; without a view it is the display picture."""
    scene, _, _ = drawn("a.png", "--color-mode", "scene", *flags)
    auto, spec, _ = drawn("b.png", *flags)
    np.testing.assert_array_equal(auto, scene)
    assert "Display" in spec.getattribute("usdsplat:view")
    display, _, _ = drawn("c.png", "--color-mode", "display")
    np.testing.assert_array_equal(drawn("d.png")[0], display)
    assert (display != scene).any()


def test_an_exr_is_baked_when_asked(drawn):
    """Oracle: the EXR that is not, through `ViewTransform`; albedo goes too, depth, which readers
    put between the two, does not."""
    flags = ("--aovs", "color,albedo,Z", "--float", *ACES)
    linear, _, _ = drawn("a.exr", *flags)
    baked, spec, _ = drawn("b.exr", *flags, "--bake-view")
    view = open_view(config=CONFIG)
    np.testing.assert_allclose(baked[..., :4], view.forward_over(linear[..., :4]), atol=1e-5)
    albedo = np.ascontiguousarray(np.concatenate([linear[..., 5:8], linear[..., 3:4]], axis=2))
    np.testing.assert_allclose(baked[..., 5:8], view.forward_over(albedo)[..., :3], atol=1e-5)
    np.testing.assert_array_equal(baked[..., 4], linear[..., 4])
    assert label(spec) == "srgb_rec709_display"
    assert "ACES" in spec.getattribute("usdsplat:view")
    alone, _, _ = drawn("c.exr", "--aovs", "albedo", "--float", *ACES, "--bake-view")
    np.testing.assert_array_equal(alone, baked[..., 5:8])


def test_what_is_of_no_display_we_know_is_not_said_to_be(drawn):
    """Oracle: the interop name for it."""
    _, spec, _ = drawn("a.exr", "--bake-view", *ACES, *REC1886)
    assert label(spec) == "unknown"
    assert spec.getattribute("chromaticities") is None


def test_a_display_picture_is_not_baked_twice(drawn):
    """Oracle: the same without the flag."""
    flags = ("--color-mode", "display", "--float")
    np.testing.assert_array_equal(
        drawn("a.exr", *flags)[0], drawn("b.exr", *flags, "--bake-view")[0]
    )


def test_inverse_view_reports_what_fails(drawn):
    """Oracle: the share of the pixels with splats that, seen through the view again, are not what
    the display picture has."""
    flags = ("--float", "--inverse-max", "1.5", *ACES)
    inverse, _, err = drawn("a.exr", "--color-mode", "inverseView", *flags)
    display, _, _ = drawn("b.exr", "--color-mode", "display", "--float")
    there = display[..., 3] > 0
    straight = (open_view(config=CONFIG).forward_over(inverse) - display)[there][:, :3]
    off = np.abs(straight / display[there][:, 3:]).max(axis=1) >= 0.5 / 255
    told = re.fullmatch(
        r"usdsplat: a.exr: pixels of splats that the view cannot reproduce: (\S+) %.*\n", err
    )
    assert 0 < off.mean() < 1
    assert float(told[1]) == pytest.approx(100 * off.mean(), rel=0.06)
    _, _, err = drawn("c.exr", "--color-mode", "inverseView")
    assert err == "usdsplat: c.exr: pixels of splats that the view cannot reproduce: none\n"


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        (["--display", "x"], "--display: found 'x', expected one of sRGB - Display"),
        (["--view", "x"], "--view: found 'x', expected one of"),
        (["--look", "x"], "--look: found 'x', expected"),
        (["--config", "x"], "--config: found 'x', expected a file or an ocio:// name"),
        (["--working-space", "x"], "--working-space: found 'x', expected one of lin_rec709"),
        (["--inverse-max", "0"], "--inverse-max: found 0.0, expected 1 to 65504"),
    ],
)
def test_colours_that_are_not_there_are_one_sentence(run, shot, tmp_path, argv, sentence):
    """Oracle: where: found X, expected Y; status 2; no file is left."""
    status, out, err = run("render", shot, "-o", tmp_path / "a.exr", *argv, *SMALL)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "a.exr").exists()
