"""Tests of encoding pictures for a page."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np

from tests.preview.web.pictures import picture
from usdsplat.preview.values import Picture
from usdsplat.preview.web.frames import frame


def unpacked(data: bytes) -> tuple[dict[str, object], Any]:
    """As the page's script reads it."""
    from PIL import Image

    (length,) = struct.unpack(">I", data[:4])
    return json.loads(data[4 : 4 + length]), Image.open(io.BytesIO(data[4 + length :]))


def error(shown: Picture, image: Any) -> float:
    """The mean of how far a decoded image is off [0..255]."""
    return float(np.abs(np.asarray(image, np.float64) - shown.image).mean())


def test_a_final_picture_arrives_bit_for_bit() -> None:
    """Oracle: the array."""
    shown = picture(number=7, splats=3, missing=2, milliseconds={"total": 1.2345}, scale=1.0)
    header, image = unpacked(frame(shown))
    assert (image.format, error(shown, image)) == ("PNG", 0.0)
    assert header["number"] == 7 and header["encoding"] == "image/png"
    assert header["missing"] == 2
    assert header["viewport"] == [48, 32] and header["milliseconds"] == {"total": 1.23}


def test_a_moving_picture_is_small_and_close() -> None:
    """Oracle: the array, and JPEG's sampling factors: colour is kept at full resolution."""
    shown = picture(is_final=False, scale=2.0)
    header, image = unpacked(frame(shown))
    assert header["encoding"] == "image/jpeg" and header["scale"] == 2.0
    assert image.format == "JPEG" and error(shown, image) < 6
    assert {layer[1:3] for layer in image.layer} == {(1, 1)}
