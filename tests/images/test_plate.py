"""Tests of reading plates as linear Rec.709."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from usdsplat.core.errors import FormatError, UsageError
from usdsplat.images.color import convert
from usdsplat.images.plate import read_plate

RGB = np.array([[[0.2, 0.4, 0.6], [0.5, 0.1, 0.3]]], np.float32)


def write(
    path: Path, pixels: np.ndarray, names: str = "RGBA", kind: str = "float", **header: str
) -> Path:
    """A file by OpenImageIO, as it is given."""
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels, np.float32))
    buffer.specmod().channelnames = tuple(names[: pixels.shape[2]])
    for key, value in header.items():
        buffer.specmod().attribute(key.replace("_", ":"), value)
    assert buffer.write(str(path), kind)
    return path


def test_a_float_picture_is_linear_rec709(tmp_path: Path) -> None:
    """Oracle: the pixels that were written; without alpha all of it counts."""
    plate = read_plate(write(tmp_path / "a.exr", RGB))
    np.testing.assert_array_equal(plate.rgb, RGB)
    assert plate.usable.all()
    assert plate.space == "lin_rec709_scene"


def test_a_picture_of_integers_is_srgb(tmp_path: Path) -> None:
    """What may be clipped does not count. Oracle: `convert`, to a step of 8 bits."""
    code = np.concatenate([RGB, [[[1.0, 0.5, 0.5]]]], axis=1)
    plate = read_plate(write(tmp_path / "a.png", code, kind="uint8"))
    expected = convert(code, "srgb_rec709_scene", "lin_rec709_scene")
    np.testing.assert_allclose(plate.rgb, expected, atol=5e-3)
    assert plate.usable.tolist() == [[True, True, False]]


def test_a_space_left_over_in_a_picture_of_integers_does_not_count(tmp_path: Path) -> None:
    """Oracle: the format: a PNG is sRGB, although OpenImageIO copies entries of an EXR into it."""
    plate = read_plate(
        write(tmp_path / "a.png", RGB, kind="uint8", colorInteropID="lin_rec709_scene")
    )
    assert plate.space == "srgb_rec709_scene"


@pytest.mark.parametrize("name", ["lin_ap1_scene", "ACEScg"])
def test_the_header_says_the_space_and_the_option_overrules_it(tmp_path: Path, name: str) -> None:
    """Oracle: `convert` from that space."""
    path = write(tmp_path / "a.exr", RGB, colorInteropID=name)
    plate = read_plate(path)
    assert plate.space == "lin_ap1_scene"
    expected = convert(RGB, "lin_ap1_scene", "lin_rec709_scene")
    np.testing.assert_allclose(plate.rgb, expected, rtol=1e-5)
    np.testing.assert_array_equal(read_plate(path, space="lin_rec709_scene").rgb, RGB)


def test_only_opaque_finite_pixels_above_black_count(tmp_path: Path) -> None:
    """Colours are straight. Oracle: the pixels, one of each kind."""
    pixels = np.array(
        [[[0.2, 0.4, 0.6, 1], [0.1, 0.2, 0.3, 0.5], [np.inf, 0, 0, 1], [0, 0, 0, 1]]], np.float32
    )
    plate = read_plate(write(tmp_path / "a.exr", pixels))
    assert plate.usable.tolist() == [[True, False, False, False]]
    np.testing.assert_array_equal(plate.rgb[0, 0], pixels[0, 0, :3])
    assert np.isfinite(plate.rgb).all()


def test_the_display_window_is_what_counts(tmp_path: Path) -> None:
    """Oracle: a crop of one pixel in a window of four by three."""
    buffer = oiio.ImageBuf(RGB[:, :1].copy())
    buffer.specmod().x, buffer.specmod().y = 2, 1
    buffer.specmod().full_width, buffer.specmod().full_height = 4, 3
    buffer.write(str(tmp_path / "a.exr"))
    plate = read_plate(tmp_path / "a.exr")
    assert plate.rgb.shape == (3, 4, 3)
    np.testing.assert_array_equal(plate.rgb[1, 2], RGB[0, 0])
    assert np.argwhere(plate.usable).tolist() == [[1, 2]]


def test_what_is_no_colour_picture_is_refused(tmp_path: Path) -> None:
    """Oracle: the sentences."""
    with pytest.raises(FormatError, match="found no such file, expected a picture"):
        read_plate(tmp_path / "nowhere.exr")
    text = tmp_path / "text.exr"
    text.write_text("not a picture")
    with pytest.raises(FormatError, match="expected a picture that OpenImageIO reads"):
        read_plate(text)
    grey = write(tmp_path / "grey.exr", RGB[..., :1], names="Y")
    with pytest.raises(FormatError, match="found channels Y, expected R, G and B"):
        read_plate(grey)
    with pytest.raises(UsageError, match="'teapot'"):
        read_plate(write(tmp_path / "a.exr", RGB), space="teapot")


@pytest.mark.parametrize(("x", "space"), [(0.713, "lin_ap1_scene"), (0.64, "lin_rec709_scene")])
def test_chromaticities_of_the_file_are_its_space(tmp_path: Path, x: float, space: str) -> None:
    """Oracle: OpenEXR's definition of the attribute; the numbers are those of AP1 (ACES S-2014-004)
    or Rec.709, rounded as other programs round them."""
    ap1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.3217, 0.3377)
    rec709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    buffer = oiio.ImageBuf(np.ascontiguousarray(RGB))
    spec = buffer.specmod()
    spec.attribute("chromaticities", "float[8]", ap1 if x == ap1[0] else rec709)
    spec.erase_attribute("oiio:ColorSpace")
    assert buffer.write(str(tmp_path / "a.exr"), "float")
    plate = read_plate(tmp_path / "a.exr")
    assert (plate.space, plate.space_source) == (space, "file")
