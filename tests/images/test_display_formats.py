"""Tests of JPEG and WebP files, read back by Pillow."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.images import open_writer
from usdsplat.images.jpeg import is_whole_jpeg
from usdsplat.images.layout import ImageLayout
from usdsplat.images.webp_writer import is_whole_webp

Image = pytest.importorskip("PIL.Image")

GREEN = (0.2, 0.8, 0.4)
WHOLE = {"a.jpg": is_whole_jpeg, "a.webp": is_whole_webp}
ENTRIES = {"usdsplat:frame": 2.5, "framesPerSecond": Fraction(24), "worldToCamera": (1.0, 0.0)}


def layout(**more):
    values = {"color_space": "srgb_rec709_display", "resolution": (70, 90), **more}
    return ImageLayout(**values)


def ramp(rows=90, columns=70):
    """Premultiplied colours without edges; nothing in the left quarter."""
    y, x = np.mgrid[:rows, :columns] / max(rows, columns)
    alpha = np.clip(2 * x - 0.4, 0, 1)
    return np.stack([alpha * y, alpha * x, alpha * 0.5, alpha], axis=-1).astype(np.float32)


def write(path, color, given):
    with open_writer(path, given) as writer:
        for y in range(0, len(color), 64):
            writer.write_band(y, {"color": color[y : y + 64]})


@pytest.mark.parametrize(("name", "within"), [("a.jpg", 8), ("a.jpeg", 8), ("a.webp", 24)])
def test_a_picture_over_a_colour_comes_back_nearly_as_it_was(tmp_path, name, within):
    """Oracle: over the colour, by hand; the empty quarter has exactly the colour."""
    color = ramp()
    write(tmp_path / name, color, layout(background=GREEN))
    with Image.open(tmp_path / name) as picture:
        assert (picture.mode, picture.size) == ("RGB", (70, 90))
        pixels = np.asarray(picture).astype(int)
    expected = 255 * (color[..., :3] + (1 - color[..., 3:]) * GREEN)
    assert np.abs(pixels - expected).max() <= within
    assert np.abs(pixels[:, :8] - (51, 204, 102)).max() <= 1


def test_a_webp_has_alpha_and_can_be_lossless(tmp_path):
    """Oracle: straight colour by hand, to half a step."""
    color = ramp()
    write(tmp_path / "a.webp", color, layout(quality=100))
    with Image.open(tmp_path / "a.webp") as picture:
        assert picture.mode == "RGBA"
        pixels = np.asarray(picture)
    covered = color[..., 3] > 0
    straight = color[covered][:, :3] / color[covered][:, 3:]
    assert np.abs(pixels[covered][:, :3] - 255 * straight).max() <= 0.51
    assert np.abs(pixels[..., 3] - 255 * color[..., 3]).max() <= 0.51


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_quality_is_size(tmp_path, name):
    """Oracle: the sizes of noise at two qualities."""
    noise = np.random.default_rng(0).random((90, 70, 4), np.float32)
    sizes = []
    for quality in (20, 90):
        write(tmp_path / name, noise, layout(background=GREEN, quality=quality))
        sizes.append((tmp_path / name).stat().st_size)
    assert sizes[0] < 0.6 * sizes[1]


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_header_entries_are_in_the_exif_description(tmp_path, name):
    """Oracle: Pillow's Exif reader; a rate is text."""
    write(tmp_path / name, ramp(), layout(background=GREEN, metadata=ENTRIES))
    with Image.open(tmp_path / name) as picture:
        entries = picture.getexif()
    assert json.loads(entries[0x010E]) == {
        "usdsplat:frame": 2.5, "framesPerSecond": "24", "worldToCamera": [1.0, 0.0],
    }  # fmt: skip
    assert entries[0x0131].startswith("usdsplat ")


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_a_pixel_aspect_ratio_is_a_pair_of_resolutions(tmp_path, name):
    """Oracle: Pillow's Exif reader; a wide pixel has fewer of them to the inch."""
    write(tmp_path / name, ramp(), layout(background=GREEN, pixel_aspect_ratio=2.0))
    with Image.open(tmp_path / name) as picture:
        entries = picture.getexif()
    assert float(entries[0x011B]) / float(entries[0x011A]) == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_truncated_files_are_known(tmp_path, name):
    """Oracle: the file, and all but its last byte."""
    write(tmp_path / name, ramp(), layout(background=GREEN))
    data = (tmp_path / name).read_bytes()
    assert WHOLE[name](tmp_path / name)
    for short in (data[:-1], data[:5], b""):
        (tmp_path / name).write_bytes(short)
        assert not WHOLE[name](tmp_path / name)


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_nothing_is_left_of_a_picture_that_fails(tmp_path, name, capfd):
    """Oracle: the folder, and that libraries say nothing."""
    writer = open_writer(tmp_path / name, layout(background=GREEN))
    with pytest.raises(RuntimeError, match="stopped"), writer:
        writer.write_band(0, {"color": ramp()[:64]})
        raise RuntimeError("stopped")
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "more", "sentence"),
    [
        ("a.jpg", {"background": None}, "found a transparent JPEG, expected a background"),
        ("a.jpg", {"pixel_type": "uint16"}, "found uint16 pixels, expected uint8 in a JPEG"),
        ("a.webp", {"aovs": ("Z",)}, "found AOVs Z, expected color only in a WebP"),
        ("a.webp", {"color_space": "lin_rec709_scene"}, "expected sRGB in a WebP"),
        ("a.webp", {"resolution": (16384, 2)}, "found 16384x2, expected at most 16383 pixels"),
        ("a.jpg", {"resolution": (2, 65501)}, "found 2x65501, expected at most 65500 pixels"),
    ],
)
def test_a_layout_that_the_format_does_not_have_is_refused(tmp_path, name, more, sentence):
    """Oracle: the sentence."""
    with pytest.raises(UsageError, match=sentence):
        open_writer(tmp_path / name, layout(**{"background": GREEN, **more}))


@pytest.mark.parametrize(("size", "fits"), [(60_000, True), (70_000, False)])
def test_header_entries_that_a_jpeg_cannot_hold_are_one_sentence(tmp_path, size, fits):
    """Oracle: a segment of a JPEG has 65,533 bytes; libjpeg ends the process beyond that."""
    given = layout(background=GREEN, metadata={"note": "y" * size})
    if fits:
        write(tmp_path / "a.jpg", ramp(), given)
        with Image.open(tmp_path / "a.jpg") as picture:
            assert json.loads(picture.getexif()[270])["note"] == "y" * size
        return
    with pytest.raises(UsageError, match="bytes of header entries, expected at most 65000"):
        open_writer(tmp_path / "a.jpg", given)
    assert list(tmp_path.iterdir()) == []
