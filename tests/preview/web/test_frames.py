"""Tests of encoding pictures for a page."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
import pytest

from tests.preview.web.pictures import picture, scenery
from usdsplat.preview.values import Picture
from usdsplat.preview.web.frames import RUNGS, Encoded, exact, message, quick, sharp


def unpacked(data: bytes) -> tuple[dict[str, Any], bytes]:
    """As the page's script reads it."""
    (length,) = struct.unpack(">I", data[:4])
    return json.loads(data[4 : 4 + length]), data[4 + length :]


def opened(encoded: Encoded) -> Any:
    """The image, by Pillow."""
    from PIL import Image

    return Image.open(io.BytesIO(encoded.image))


def error(shown: Picture, image: Any) -> float:
    """The mean of how far a decoded image is off [0..255]."""
    return float(np.abs(np.asarray(image, np.float64) - shown.image).mean())


def test_an_exact_picture_arrives_bit_for_bit() -> None:
    """Oracle: the array."""
    shown = picture(number=7, splats=3, missing=2, milliseconds={"total": 1.2345}, scale=1.0)
    found = exact(shown)
    assert (opened(found).format, error(shown, opened(found))) == ("WEBP", 0.0)
    assert found.header["number"] == 7 and found.header["encoding"] == "image/webp"
    assert found.header["missing"] == 2 and found.header["is_final"]
    assert found.header["viewport"] == [48, 32] and found.header["milliseconds"] == {"total": 1.23}


def test_a_sharp_picture_has_all_pixels_and_is_close() -> None:
    """Oracle: the array; an exact picture is several times as large."""
    shown = scenery()
    found = sharp(shown)
    assert opened(found).size == (480, 320) and error(shown, opened(found)) < 4
    assert 3 * len(found.image) < len(exact(shown).image)
    assert found.header["is_sharp"] and not found.header["is_final"]


def test_a_quick_picture_on_a_fast_link_keeps_small_colours() -> None:
    """Oracle: the array, and JPEG's sampling factors: colour is kept at full resolution."""
    shown = picture(is_final=False, scale=2.0, image=picture().image[::2, ::2])
    found = quick(shown, 1e9)
    assert found.header["encoding"] == "image/jpeg" and found.header["scale"] == 2.0
    assert opened(found).format == "JPEG" and error(shown, opened(found)) < 8
    assert {layer[1:3] for layer in opened(found).layer} == {(1, 1)}


@pytest.mark.parametrize("budget", [40_000, 12_000, 6_000, 2_500, 1_200])
def test_a_quick_picture_fits_its_budget_and_uses_it(budget: int) -> None:
    """Oracle: the number of bytes; the next better rung needs more than the budget."""
    shown = scenery(is_final=False)
    found = quick(shown, budget)
    assert len(found.image) <= budget
    assert len(found.image) > 0.3 * budget
    again = quick(shown, budget, detail=found.detail)
    assert 0.5 * len(found.image) <= len(again.image) <= budget


def test_the_last_rung_is_sent_whatever_it_needs() -> None:
    """Oracle: the size of an encoded pixel of the last rung."""
    found = quick(scenery(is_final=False), 10)
    assert found.header["scale"] == pytest.approx(RUNGS[-1].scale, rel=0.02)
    assert opened(found).size == (60, 40)


def test_the_parts_of_a_picture_are_its_image() -> None:
    """Oracle: put together they are the encoded bytes; the first has what there is to know."""
    found = exact(scenery())
    parts = [unpacked(message(found, part, 7, message=100 + part)) for part in range(7)]
    assert b"".join(body for _, body in parts) == found.image
    assert [head["message"] for head, _ in parts] == list(range(100, 107))
    assert parts[0][0]["width"] == 480
    assert set(parts[1][0]) == {"number", "part", "parts", "message"}
