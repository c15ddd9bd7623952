"""Tests of the colour behind pictures for displays."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images.background import described, over, parse_background
from usdsplat.images.display_writer import quantized

Image = pytest.importorskip("PIL.Image")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("transparent", None),
        ("black", (0, 0, 0)),
        ("White", (1, 1, 1)),
        ("grey", (56 / 255,) * 3),
        ("gray", (56 / 255,) * 3),
        ("#20407f", (32 / 255, 64 / 255, 127 / 255)),
        ("#20407F", (32 / 255, 64 / 255, 127 / 255)),
        ("0.25, 1,0", (0.25, 1, 0)),
        (" Auto ", (1, 0, 0)),
        (" White ", (1, 1, 1)),
        (" transparent", None),
    ],
)
def test_texts_are_colours(text, expected):
    """Oracle: the values, written by hand."""
    assert parse_background(text, auto="1,0,0", where="--background") == expected


@pytest.mark.parametrize("text", ["", "red", "#fff", "255,255,255", "1,1", "nan,0,0", "-0.1,0,0"])
def test_other_texts_are_refused(text):
    """Oracle: the sentence: where it is from, what was found, and what is possible."""
    with pytest.raises(UsageError, match=r"^--background: found '.*', expected auto, transparent"):
        parse_background(text, auto="1,0,0", where="--background")


def test_a_colour_is_described_as_it_can_be_asked_for():
    """Oracle: parsing again."""
    assert described(None) == "transparent"
    for text in ("#000000", "#20407f", "#ffffff"):
        assert described(parse_background(text, auto="black", where="")) == text


def test_a_picture_over_a_colour_is_what_other_programs_composite():
    """Oracle: Pillow's alpha compositing of the transparent picture, which rounds twice, also where
    colours are brighter than white; empty pixels are the colour itself."""
    rng = np.random.default_rng(4)
    alpha = rng.random((40, 50, 1))
    color = np.concatenate([1.3 * alpha * rng.random((40, 50, 3)), alpha], axis=-1)
    color = color.astype(np.float32)
    color[0] = 0
    behind = (0.2, 0.8, 0.5)
    transparent = Image.fromarray(quantized(color, np.uint8), "RGBA")
    sheet = Image.new("RGBA", transparent.size, (51, 204, 128, 255))
    expected = np.asarray(Image.alpha_composite(sheet, transparent))[..., :3]
    shown = over(color, behind)
    assert np.abs(255 * shown - expected).max() <= 1.5
    np.testing.assert_array_equal(shown[0], np.broadcast_to(np.float32(behind), (50, 3)))
