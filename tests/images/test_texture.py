"""Tests of textures, from file to linear Rec.709."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.delegate.surface_stages import write_picture
from usdsplat.core.errors import FormatError
from usdsplat.images.color import convert
from usdsplat.images.texture import read_packed_texture, read_texture


def bytes_of(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


@pytest.mark.parametrize(("encoding", "decoded"), [("auto", True), ("sRGB", True), ("raw", False)])
def test_eight_bit_colour_is_srgb_unless_it_is_raw(tmp_path: Path, encoding, decoded) -> None:
    """Oracle: `convert` in float64, on the file's own numbers."""
    pixels = bytes_of(1, 4, 5, 3)
    found = read_texture(write_picture(tmp_path / "a.png", pixels), encoding=encoding)
    plain = pixels / 255.0
    expected = convert(plain, "srgb_rec709_scene", "lin_rec709_scene") if decoded else plain
    assert found.dtype == np.float32 and found.shape == (4, 5, 3)
    assert np.abs(found - expected).max() <= 1e-6


def test_float_pictures_are_linear_and_may_pass_one(tmp_path: Path) -> None:
    """Oracle: the numbers written."""
    pixels = np.random.default_rng(2).uniform(0, 8, (3, 2, 3)).astype(np.float32)
    assert np.array_equal(read_texture(write_picture(tmp_path / "a.exr", pixels)), pixels)
    decoded = read_texture(tmp_path / "a.exr", encoding="sRGB")
    expected = convert(pixels, "srgb_rec709_scene", "lin_rec709_scene")
    assert np.allclose(decoded, expected, rtol=1e-6)


def test_grey_is_raw_and_becomes_three_channels_and_alpha_goes(tmp_path: Path) -> None:
    """Oracle: the numbers written; UsdUVTexture decodes 8-bit pictures of 3 and 4 channels only."""
    grey = bytes_of(3, 2, 2, 1)
    found = read_texture(write_picture(tmp_path / "grey.png", grey))
    assert np.allclose(found, np.repeat(grey, 3, axis=2) / 255.0, atol=1e-7)
    rgba = np.concatenate([bytes_of(4, 2, 2, 3), np.full((2, 2, 1), 255, np.uint8)], axis=2)
    assert read_texture(write_picture(tmp_path / "rgba.png", rgba)).shape == (2, 2, 3)


def test_what_is_too_large_is_averaged_after_decoding(tmp_path: Path) -> None:
    """Oracle: means of squares, written out; edges have fewer pixels."""
    pixels = bytes_of(5, 5, 7, 3)
    found = read_texture(write_picture(tmp_path / "a.png", pixels), largest=3)
    linear = convert(pixels / 255.0, "srgb_rec709_scene", "lin_rec709_scene")
    expected = [[linear[y : y + 3, x : x + 3].mean(axis=(0, 1)) for x in (0, 3, 6)] for y in (0, 3)]
    assert found.shape == (2, 3, 3)
    assert np.abs(found - np.array(expected)).max() <= 1e-6


def test_bytes_read_like_the_file_they_are_of(tmp_path: Path) -> None:
    """Oracle: the same picture read by its path."""
    path = Path(write_picture(tmp_path / "a.png", bytes_of(6, 3, 3, 3)))
    found = read_packed_texture(path.read_bytes(), "folder/b.png")
    assert np.array_equal(found, read_texture(path))


@pytest.mark.parametrize("content", [None, b"", b"\x89PNG\r\n\x1a\n nothing"])
def test_what_is_no_picture_is_one_sentence(tmp_path: Path, content: bytes | None) -> None:
    """Oracle: the error's class, and that it names the file."""
    path = tmp_path / "a.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.png: found .*expected a picture") as caught:
        read_texture(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(FormatError, match=r"^packed\.png: found"):
        read_packed_texture(content or b"", "packed.png")
