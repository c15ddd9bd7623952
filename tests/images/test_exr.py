"""Tests of EXR files: exact contents, and files left when writing fails."""

from __future__ import annotations

import struct
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

import usdsplat
from tests.images.exr_file import ExrFile
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.images.compression import FLAT_COMPRESSIONS
from usdsplat.images.exr import ExrWriter
from usdsplat.images.layout import ImageLayout

ALL = ("color", "Z", "id", "splatId")


def picture(rows, columns, seed=0):
    """Random pixels of every AOV; ids need all of their 32 bits, Z has empty pixels."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.01, 1e6, (rows, columns)).astype(np.float32)
    depth[::3, ::5] = np.inf
    return {
        "color": rng.uniform(0, 8, (rows, columns, 4)).astype(np.float32),
        "Z": depth,
        "id": rng.integers(2**24 + 1, 2**32, (rows, columns), np.uint32),
        "splatId": rng.integers(2**31, 2**32, (rows, columns), np.uint32),
    }


def write(path, layout, pixels, *, height=7, **options):
    """Feed `pixels` in bands of `height` rows."""
    top, bottom = layout.window[1], layout.window[3]
    with ExrWriter(path, replace(layout, **options)) as writer:
        for y in range(top, bottom, height):
            rows = slice(y - top, min(y + height, bottom) - top)
            writer.write_band(y, {name: array[rows] for name, array in pixels.items()})


@pytest.mark.parametrize("pixel_type", ["half", "float"])
def test_pixels_arrive_as_they_were(tmp_path, pixel_type):
    """Oracle: a byte-level reader of the EXR layout; half rounds colour as NumPy's float16 does."""
    layout = ImageLayout(resolution=(50, 33), aovs=ALL, pixel_type=pixel_type)
    pixels = picture(33, 50)
    write(tmp_path / "a.exr", layout, pixels, compression="none")
    file = ExrFile(tmp_path / "a.exr")
    main, ids = file.parts[0][1], file.parts[1][1]
    color_type = np.float16 if pixel_type == "half" else np.float32
    assert {name: array.dtype for name, array in main.items()} == {
        **dict.fromkeys("RGBA", color_type),
        "Z": np.float32,
    }
    assert {name: array.dtype for name, array in ids.items()} == dict.fromkeys(ALL[2:], np.uint32)
    color = np.stack([main[c] for c in "RGBA"], axis=2)
    np.testing.assert_array_equal(color, pixels["color"].astype(color_type))
    for name, arrays in (("Z", main), ("id", ids), ("splatId", ids)):
        np.testing.assert_array_equal(arrays[name], pixels[name])


@pytest.mark.parametrize("compression", FLAT_COMPRESSIONS)
def test_every_compression_keeps_depth_and_ids_exactly(tmp_path, compression):
    """Oracle: OpenImageIO's own reader."""
    layout = ImageLayout(resolution=(70, 150), aovs=ALL)
    pixels = picture(150, 70)
    write(tmp_path / "a.exr", layout, pixels, height=64, compression=compression)
    file = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(file.read_image(0, 0, 4, 5, "float"), pixels["Z"][..., None])
    ids = file.read_image(1, 0, 0, 2, "uint")
    file.close()
    np.testing.assert_array_equal(ids, np.stack([pixels["id"], pixels["splatId"]], axis=2))


def test_windows_say_where_the_pixels_belong(tmp_path):
    """Oracle: the header's own box2i values, read as bytes; overscan left, crop below."""
    layout = ImageLayout(
        resolution=(40, 30), data_window=(-6, -2, 45, 21), aovs=ALL, pixel_aspect_ratio=2.0
    )
    write(tmp_path / "a.exr", layout, picture(23, 51), compression="none")
    file = ExrFile(tmp_path / "a.exr")
    for part in (0, 1):
        assert file.window(part) == (-6, -2, 45, 21)
        assert file.window(part, "displayWindow") == (0, 0, 40, 30)
        aspect = file.parts[part][0]["pixelAspectRatio"]
        assert aspect == ("float", struct.pack("<f", 2.0))


def test_ids_alone_are_a_part_of_their_own(tmp_path):
    """Oracle: the byte-level reader finds one part, of uint32, labelled like any picture."""
    layout = ImageLayout(resolution=(9, 5), aovs=("splatId",))
    pixels = picture(5, 9)
    write(tmp_path / "a.exr", layout, pixels, compression="none")
    file = ExrFile(tmp_path / "a.exr")
    assert len(file.parts) == 1
    np.testing.assert_array_equal(file.parts[0][1]["splatId"], pixels["splatId"])
    assert "Software" in file.parts[0][0]


def test_the_header_says_what_the_picture_is(tmp_path):
    """Oracle: attribute names and types of OpenEXR's standard attributes, read as bytes."""
    matrix = tuple(float(i) for i in range(16))
    layout = ImageLayout(
        resolution=(4, 4),
        aovs=("color", "Z"),
        metadata={
            "worldToCamera": matrix,
            "worldToNDC": matrix,
            "screenWindowCenter": (0.25, -0.5),
            "screenWindowWidth": 1.5,
            "usdsplat:stage": "shot.usd",
            "usdsplat:frame": 12.5,
        },
    )
    write(tmp_path / "a.exr", layout, picture(4, 4))
    header = ExrFile(tmp_path / "a.exr").parts[0][0]
    m44f = ("m44f", struct.pack("<16f", *matrix))
    rec709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
    assert header["worldToCamera"] == header["worldToNDC"] == m44f
    assert header["screenWindowCenter"] == ("v2f", struct.pack("<2f", 0.25, -0.5))
    assert header["screenWindowWidth"] == ("float", struct.pack("<f", 1.5))
    assert header["chromaticities"] == ("chromaticities", struct.pack("<8f", *rec709))
    assert header["colorInteropID"] == ("string", b"lin_rec709_scene")
    assert header["Software"] == ("string", f"usdsplat {usdsplat.__version__}".encode())
    assert header["usdsplat:stage"] == ("string", b"shot.usd")
    assert header["usdsplat:frame"] == ("float", struct.pack("<f", 12.5))
    assert b"half of the pixel's coverage" in header["usdsplat:aov:Z"][1]


@pytest.mark.parametrize(
    ("space", "label"),
    [
        ("lin_rec709_scene", "lin_rec709_scene"),
        ("lin_ap1_scene", "lin_ap1_scene"),
        ("srgb_rec709_display", "srgb_rec709_display"),
        ("raw", "data"),
    ],
)
def test_the_color_space_is_read_back(tmp_path, space, label):
    """Oracle: OpenImageIO's reader, and the interop id as text."""
    layout = ImageLayout(resolution=(4, 4), color_space=space)
    write(tmp_path / "a.exr", layout, picture(4, 4))
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert spec.getattribute("colorInteropID") == label
    assert spec.getattribute("oiio:ColorSpace") == label
    white = spec.getattribute("chromaticities")
    assert (white is None) == (space == "raw")
    if space == "lin_ap1_scene":
        assert white[6:] == pytest.approx((0.32168, 0.33767))


def test_a_failure_leaves_the_older_file_and_nothing_else(tmp_path):
    """Oracle: the folder before; an exception on the way is an interrupted render."""
    (tmp_path / "a.exr").write_bytes(b"older")
    layout = ImageLayout(resolution=(8, 8), aovs=ALL)
    with pytest.raises(KeyboardInterrupt), ExrWriter(tmp_path / "a.exr", layout) as writer:
        writer.write_band(0, picture(4, 8))
        raise KeyboardInterrupt
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert (tmp_path / "a.exr").read_bytes() == b"older"


def test_a_picture_with_rows_missing_is_no_picture(tmp_path):
    """Oracle: the contract, that whole files appear or none."""
    layout = ImageLayout(resolution=(8, 8))
    with (
        pytest.raises(ValueError, match="found rows to 4, expected 8"),
        ExrWriter(tmp_path / "a.exr", layout) as writer,
    ):
        writer.write_band(0, picture(4, 8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("y0", "change", "message"),
    [
        (1, {}, "found rows 1 to 5, expected 0 on"),
        (0, {"color": np.zeros((9, 8, 4), np.float32)}, "found rows 0 to 9"),
        (0, {"color": np.zeros((4, 8, 3), np.float32)}, r"color: found float32\(4, 8, 3\)"),
        (0, {"color": np.zeros((4, 8, 4))}, r"found float64\(4, 8, 4\), expected float32"),
        (0, {"id": np.zeros((4, 8), np.int32)}, r"id: found int32\(4, 8\), expected uint32"),
    ],
)
def test_bands_that_do_not_fit_are_refused(tmp_path, y0, change, message):
    """Oracle: the shapes and dtypes that the AOV table promises."""
    aovs = ("color", "id") if "id" in change else ("color",)
    layout = ImageLayout(resolution=(8, 8), aovs=aovs)
    with (
        pytest.raises(ValueError, match=message),
        ExrWriter(tmp_path / "a.exr", layout) as writer,
    ):
        writer.write_band(y0, {**picture(4, 8), **change})


def test_a_missing_array_is_refused(tmp_path):
    """Oracle: the AOV table."""
    with (
        pytest.raises(ValueError, match="Z: found nothing"),
        ExrWriter(tmp_path / "a.exr", ImageLayout(resolution=(8, 8), aovs=("color", "Z"))) as out,
    ):
        out.write_band(0, {"color": np.zeros((8, 8, 4), np.float32)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixel_type": "uint8"}, "found uint8 pixels, expected half or float"),
        ({"aovs": ("color", "zz")}, "found 'zz', expected one of color, Z"),
        ({"aovs": ("Z", "Z")}, "'Z,Z', expected one or more names, each once"),
        ({"aovs": ()}, "one or more names"),
        ({"color_space": "acescg"}, "output color space: found 'acescg'"),
        ({"compression": "b44"}, "compression 'b44', expected one of none, rle"),
        ({"compression": "zip:10"}, "compression 'zip:10', expected a whole number from 1 to 9"),
        ({"compression": "piz:3"}, "compression 'piz:3', expected piz without a level"),
    ],
)
def test_what_exr_cannot_hold_is_refused_before_it_is_opened(tmp_path, change, message):
    """Oracle: one sentence, where: found X, expected Y."""
    with pytest.raises(UsageError, match=message):
        ExrWriter(tmp_path / "a.exr", ImageLayout(**{"resolution": (8, 8), **change}))


def test_a_file_that_openimageio_refuses_is_one_sentence(tmp_path):
    """Oracle: OpenEXR allows no data window that is empty."""
    layout = ImageLayout(resolution=(8, 8), data_window=(4, 4, 4, 4))
    with pytest.raises(OutputError, match=r"a\.exr: found"), ExrWriter(tmp_path / "a.exr", layout):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_build_without_the_format_is_one_sentence(tmp_path, monkeypatch):
    """Oracle: OpenImageIO knows no format of this name."""
    monkeypatch.setattr(ExrWriter, "FORMAT", "nonesuch")
    writer = ExrWriter(tmp_path / "a.exr", ImageLayout(resolution=(8, 8)))
    with pytest.raises(OutputError, match="expected support for nonesuch"), writer:
        pass


BIG = """
import resource, sys, numpy as np
from usdsplat.images.exr import ExrWriter
from usdsplat.images.layout import ImageLayout
w, h, rows = 3840, 2160, 40
aovs = ("color", "Z", "id", "splatId")
layout = ImageLayout(
    resolution=(w, h), aovs=aovs, multipart=sys.argv[2] == "True", compression="rle"
)
band = {
    "color": np.ones((rows, w, 4), np.float32), "Z": np.ones((rows, w), np.float32),
    "id": np.ones((rows, w), np.uint32), "splatId": np.ones((rows, w), np.uint32),
}
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
with ExrWriter(sys.argv[1], layout) as out:
    for y in range(0, h, rows):
        out.write_band(y, band)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.parametrize("multipart", [False, True])
def test_memory_holds_a_band_however_large_the_picture(tmp_path, multipart):
    """Oracle: peak memory of a process; the pixels of this 4K picture are 232 MB."""
    argv = [sys.executable, "-c", BIG, str(tmp_path / "big.exr"), str(multipart)]
    run = subprocess.run(argv, capture_output=True, text=True, check=True)
    assert run.stderr == ""
    assert int(run.stdout) < 60_000  # kB


@pytest.mark.parametrize("pixel_type", ["half", "float"])
def test_colour_beyond_half_is_its_largest_number(tmp_path, pixel_type):
    """Oracle: 65504 from IEEE 754; 65520 would round to infinity. Float and depth keep theirs."""
    layout = ImageLayout(resolution=(6, 1), aovs=("color", "Z"), pixel_type=pixel_type)
    values = np.float32([[65504, 65520, 1e9, -1e9, np.inf, np.nan]])
    color = np.repeat(values[:, :, None], 4, axis=2)
    write(tmp_path / "a.exr", layout, {"color": color, "Z": values}, compression="none")
    main = ExrFile(tmp_path / "a.exr").parts[0][1]
    clamped = [[65504, 65504, 65504, -65504, 65504, np.nan]]
    expected = clamped if pixel_type == "half" else values
    for channel in "RGBA":
        np.testing.assert_array_equal(main[channel], expected)
    np.testing.assert_array_equal(main["Z"], values)
    np.testing.assert_array_equal(color[:, :, 0], values)
