"""Tests of PNG files: straight colour, rounding and labels."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.display_writer import quantized
from usdsplat.images.layout import ImageLayout
from usdsplat.images.png import PngWriter, is_whole_png

Image = pytest.importorskip("PIL.Image")

SRGB = "srgb_rec709_display"


def write(path, layout, color, *, height=5):
    """Feed `color` in bands of `height` rows."""
    top, bottom = layout.window[1], layout.window[3]
    with PngWriter(path, layout) as writer:
        for y in range(top, bottom, height):
            writer.write_band(y, {"color": color[y - top : min(y + height, bottom) - top]})


def chunks(path):
    """Chunk name -> its bytes; checks every checksum."""
    data, at, found = path.read_bytes(), 8, {}
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        name, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        assert struct.unpack_from(">I", data, at + 8 + size)[0] == zlib.crc32(name + body)
        found[name.decode()] = found.get(name.decode(), b"") + body
        at += 12 + size
    return found


def test_eight_bits_are_straight_colour_rounded_half_up(tmp_path):
    """Oracle: Pillow reads the file; values chosen so that each rule decides one of them."""
    color = np.zeros((7, 11, 4), np.float32)
    color[0, 0] = (0.25, 0.5, 0.125, 0.5)  # divided by alpha: 0.5, 1, 0.25
    color[0, 1] = (0.5 / 255, 1.499 / 255, 1.501 / 255, 1.0)  # 1, 1, 2
    color[0, 2] = (-0.1, 7.0, 1.0, 1.0)  # clipped
    color[0, 3] = (0.3, 0.3, 0.3, 0.0)  # light without coverage has no place in a PNG
    write(tmp_path / "a.png", ImageLayout(resolution=(11, 7), color_space=SRGB), color)
    with Image.open(tmp_path / "a.png") as picture:
        assert (picture.size, picture.mode) == ((11, 7), "RGBA")
        pixels = np.asarray(picture)
    np.testing.assert_array_equal(
        pixels[0, :4], [(128, 255, 64, 128), (1, 1, 2, 255), (0, 255, 255, 255), (0, 0, 0, 0)]
    )
    assert not pixels[1:].any()


def test_sixteen_bits_keep_sixteen(tmp_path):
    """Oracle: the samples of the file, deflated and unfiltered here by the PNG specification."""
    rng = np.random.default_rng(1)
    color = rng.uniform(0, 1, (6, 8, 4)).astype(np.float32)
    color[..., 3] = 1
    layout = ImageLayout(resolution=(8, 6), color_space=SRGB, pixel_type="uint16")
    write(tmp_path / "a.png", layout, color)
    found = chunks(tmp_path / "a.png")
    assert struct.unpack(">IIBBBBB", found["IHDR"]) == (8, 6, 16, 6, 0, 0, 0)
    rows = np.frombuffer(zlib.decompress(found["IDAT"]), np.uint8).reshape(6, 1 + 8 * 8)
    assert set(rows[:, 0]) == {1}  # every row is differences to the pixel on the left
    sums = rows[:, 1:].reshape(6, 8, 8).cumsum(axis=1, dtype=np.uint8)
    samples = np.ascontiguousarray(sums).view(">u2").astype(np.int64)
    np.testing.assert_array_equal(samples, np.floor(color.astype(np.float64) * 65535 + 0.5))


def test_the_file_says_srgb_and_who_made_it(tmp_path):
    """Oracle: the chunks that the PNG specification gives for it."""
    layout = ImageLayout(
        resolution=(2, 2),
        color_space=SRGB,
        pixel_aspect_ratio=2.0,
        metadata={"usdsplat:stage": "shot.usd", "worldToCamera": (0.0,) * 16},
    )
    write(tmp_path / "a.png", layout, np.zeros((2, 2, 4), np.float32))
    found = chunks(tmp_path / "a.png")
    assert "sRGB" in found
    assert struct.unpack(">I", found["gAMA"])[0] == pytest.approx(45455, abs=10)
    assert b"Software\0usdsplat" in found["tEXt"]
    assert b"usdsplat:stage\0shot.usd" in found["tEXt"]
    across, down, _ = struct.unpack(">IIB", found["pHYs"])
    assert down == pytest.approx(2 * across, rel=0.02)  # whole pixels per inch or metre


def test_a_crop_holds_its_own_pixels(tmp_path):
    """Oracle: Pillow; one pixel of the crop is lit."""
    color = np.zeros((3, 4, 4), np.float32)
    color[1, 2] = 1
    layout = ImageLayout(resolution=(20, 10), data_window=(-1, 5, 3, 8), color_space=SRGB)
    write(tmp_path / "a.png", layout, color, height=2)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (4, 3)
        assert np.argwhere(np.asarray(picture)[..., 3]).tolist() == [[1, 2]]


def test_quantisation_inverts_premultiplication():
    """Oracle: straight colours that are whole steps, premultiplied in float64, come back."""
    steps = np.arange(256)
    straight = np.stack([steps, steps[::-1], np.full(256, 17)], axis=1)
    for alpha in (1.0, 0.7, 0.01):
        rgba = np.concatenate([straight / 255 * alpha, np.full((256, 1), alpha)], axis=1)
        result = quantized(rgba.astype(np.float32), np.uint8)
        np.testing.assert_array_equal(result[:, :3], straight)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixel_type": "half"}, "half pixels, expected uint8 or uint16"),
        ({"aovs": ("color", "Z")}, "AOVs color, Z, expected color only"),
        ({"color_space": "lin_rec709_scene"}, "picture in lin_rec709_scene, expected sRGB"),
    ],
)
def test_what_png_cannot_hold_is_refused(tmp_path, change, message):
    """Oracle: one sentence, where: found X, expected Y."""
    layout = ImageLayout(**{"resolution": (8, 8), "color_space": SRGB, **change})
    with pytest.raises(UsageError, match=message):
        PngWriter(tmp_path / "a.png", layout)


@pytest.mark.parametrize("rows", [0, 30])
def test_an_interrupted_picture_is_silent(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], rows: int
) -> None:
    """Oracle: file descriptor 2, on which libpng prints if a file has too few rows."""
    layout = ImageLayout(resolution=(200, 100), aovs=("color",), color_space="srgb_rec709_display")
    with pytest.raises(KeyboardInterrupt), PngWriter(tmp_path / "a.png", layout) as writer:
        if rows:
            writer.write_band(0, {"color": np.zeros((rows, 200, 4), np.float32)})
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_every_missing_byte_is_noticed(tmp_path: Path) -> None:
    """Oracle: Pillow's PNG is whole; the same bytes without some at any place are not, and neither
    are more bytes or another file."""
    rng = np.random.default_rng(1)
    path = tmp_path / "a.png"
    Image.fromarray(rng.integers(0, 255, (9, 9, 3), np.uint8)).save(path)
    data = path.read_bytes()
    assert is_whole_png(path)
    for missing in (1, 4, 12):
        for start in range(len(data) - missing + 1):
            path.write_bytes(data[:start] + data[start + missing :])
            assert not is_whole_png(path), (start, missing)
    for other in (data + b"x", b"", data[:8], b"exr"):
        path.write_bytes(other)
        assert not is_whole_png(path)
