"""Tests of sizes that WebP files declare. Oracle: Pillow."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest

from tests.formats.samples import declared_webp, webp
from usdsplat.core.errors import FormatError
from usdsplat.formats.webp import decode, image_size


@pytest.mark.parametrize("size", [(1, 1), (3, 7), (200, 5)])
def test_size_and_pixels_are_those_that_were_saved(size):
    """Oracle: the array that Pillow saved."""
    pixels = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 4))
    data = webp(pixels)
    assert image_size("a", data) == size
    np.testing.assert_array_equal(decode("a", data), pixels.reshape(-1, 4))


def test_images_without_alpha_are_opaque():
    """Oracle: Pillow saves RGB images without an alpha plane."""
    from PIL import Image

    out = io.BytesIO()
    Image.new("RGB", (2, 1), (1, 2, 3)).save(out, "WEBP", lossless=True)
    assert decode("a", out.getvalue()).tolist() == [[1, 2, 3, 255]] * 2


def test_the_extended_header_is_read(tmp_path):
    """Oracle: Pillow writes one when there is metadata to keep."""
    from PIL import Image

    out = io.BytesIO()
    Image.new("RGBA", (6, 5)).save(out, "WEBP", lossless=True, xmp=b"<x/>")
    assert out.getvalue()[12:16] == b"VP8X"
    assert image_size("a", out.getvalue()) == (6, 5)
    larger = bytearray(out.getvalue())
    larger[24:27] = struct.pack("<I", 999)[:3]
    with pytest.raises(FormatError, match="one size"):
        image_size("a", bytes(larger))


def test_the_largest_size_is_declared_without_being_unpacked():
    """Oracle: 14 bits a side."""
    assert image_size("a", declared_webp(16384, 16384)) == (16384, 16384)


def saved(**options) -> bytes:
    from PIL import Image

    out = io.BytesIO()
    Image.new("RGBA", (4, 4), (9, 8, 7, 6)).save(out, "WEBP", **options)
    return out.getvalue()


def animated() -> bytes:
    from PIL import Image

    frames = [Image.new("RGBA", (4, 4), (shade, 0, 0, 255)) for shade in (1, 200)]
    out = io.BytesIO()
    frames[0].save(out, "WEBP", lossless=True, save_all=True, append_images=frames[1:])
    return out.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected a WebP image"),
        (b"RIFF\0\0\0\0WAVE", "expected a WebP image"),
        (declared_webp(4, 4)[:20], "lossy, animated or damaged"),
        (declared_webp(4, 4)[:23], "lossy, animated or damaged"),
        (saved(quality=50), "lossy, animated or damaged"),
        (animated(), "lossy, animated or damaged"),
        (b"RIFF\0\0\0\0WEBP" + struct.pack("<4sI", b"JUNK", 2**32 - 1), "damaged"),
    ],
)
def test_what_is_no_lossless_still_image_is_refused(data, message):
    """Oracle: Pillow made, or a pen cut, something else."""
    with pytest.raises(FormatError, match=message):
        image_size("a", data)


def test_damaged_pixels_are_refused():
    """Oracle: half of a file."""
    data = webp(np.random.default_rng(0).integers(0, 256, (64, 64, 4)))
    with pytest.raises(FormatError, match="damaged WebP data"):
        decode("a", data[: len(data) // 2])
