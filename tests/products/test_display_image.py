"""Tests of display-referred pictures, read back by Pillow."""

from __future__ import annotations

import json
import os
from fractions import Fraction

import numpy as np
import pytest

from usdsplat.core.errors import UnknownFormatError
from usdsplat.images.exif import DESCRIPTION, WRITER
from usdsplat.products.display_image import save_image


def pixels(path):
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


@pytest.mark.parametrize(("name", "within"), [("a.png", 0), ("a.jpg", 24), ("A.JPEG", 24)])
def test_an_image_comes_back_as_it_was(tmp_path, name, within):
    """Oracle: Pillow's decoder; PNG is exact, JPEG near, for a ramp without edges."""
    ramp = np.linspace(0, 255, 64, dtype=np.uint8)
    image = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None, :], np.uint8(90)), axis=-1)
    assert save_image(image, tmp_path / name) == tmp_path / name
    assert abs(pixels(tmp_path / name) - image).max() <= within
    assert os.listdir(tmp_path) == [name]


def test_a_header_comes_back_as_it_was(tmp_path):
    """Oracle: Pillow's decoder: chunks of a PNG, the Exif description of a JPEG. A rate is
    text."""
    from PIL import Image

    image = np.zeros((2, 2, 3), np.uint8)
    entries = {"usdsplat:stage": "Größe.usda", "usdsplat:frame": 2.5, "worldToCamera": (1.0, 0.0)}
    entries["framesPerSecond"] = Fraction(24000, 1001)
    with Image.open(save_image(image, tmp_path / "a.png", metadata=entries)) as picture:
        assert picture.text["usdsplat:stage"] == "Größe.usda"
        assert json.loads(picture.text["usdsplat:frame"]) == 2.5
        assert json.loads(picture.text["worldToCamera"]) == [1.0, 0.0]
        assert picture.text["Software"] == WRITER
    with Image.open(save_image(image, tmp_path / "a.jpg", metadata=entries)) as picture:
        told = json.loads(picture.getexif()[DESCRIPTION])
    assert told == {**entries, "worldToCamera": [1.0, 0.0], "framesPerSecond": "24000/1001"}


def test_another_suffix_is_a_sentence(tmp_path):
    """Oracle: the suffixes, in the sentence; nothing is written."""
    image = np.zeros((2, 2, 3), np.uint8)
    with pytest.raises(UnknownFormatError, match=r"found suffix '.gif', expected one of .png"):
        save_image(image, tmp_path / "a.gif")
    assert os.listdir(tmp_path) == []
