"""Tests of deep EXR files: exact contents, and reading by other libraries."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

import usdsplat
from tests.images.test_images import small_disk
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.deep_reader import read_deep
from usdsplat.images.labels import picture_metadata
from usdsplat.images.layout import ImageLayout

OIIOTOOL = str(Path(sys.executable).with_name("oiiotool"))


def deep_picture(rows, columns, seed=0, most=6):
    """Random samples, in order; some pixels, and the last row, have none."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, most + 1, (rows, columns)).astype(np.uint32)
    counts[-1] = 0
    pixel = np.repeat(np.arange(rows * columns), counts.ravel())
    depth = rng.uniform(1, 100, len(pixel)).astype(np.float32)
    depth = depth[np.lexsort((depth, pixel))]
    alpha = rng.uniform(0, 1, (len(pixel), 1)).astype(np.float32)
    color = np.concatenate(
        [rng.uniform(0, 4, (len(pixel), 3)).astype(np.float32) * alpha, alpha], 1
    )
    return DeepBand(counts=counts, depth=depth, depth_back=depth + np.float32(0.5), color=color)


def rows_of(band, y0, y1):
    """Some rows of a band."""
    ends = [0, *np.cumsum(band.counts.sum(axis=1)).tolist()]
    part = slice(ends[y0], ends[y1])
    return DeepBand(
        counts=band.counts[y0:y1],
        depth=band.depth[part],
        depth_back=band.depth_back[part],
        color=band.color[part],
    )


def write_deep(path, band, *, height=7, layout=None, merged=False, compression=""):
    """Feed a picture in bands of `height` rows."""
    rows, columns = band.counts.shape
    layout = layout or ImageLayout(resolution=(columns, rows), pixel_type="float")
    top = layout.window[1]
    with DeepWriter(path, replace(layout, compression=compression), merged=merged) as writer:
        for y in range(0, rows, height):
            writer.write_band(top + y, rows_of(band, y, min(y + height, rows)))


def flattened(band):
    """Samples over each other, near over far, in float64, one by one; shape (rows, columns, 4)."""
    picture = np.zeros((band.counts.size, 4))
    at = 0
    for pixel, count in enumerate(band.counts.ravel().tolist()):
        for sample in band.color[at : at + count].astype(np.float64):
            picture[pixel] += (1 - picture[pixel, 3]) * sample
        at += count
    return picture.reshape(*band.counts.shape, 4)


def oiiotool(*arguments):
    """Run it; return what it says."""
    run = subprocess.run([OIIOTOOL, *map(str, arguments)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "error" not in (run.stdout + run.stderr).lower()
    return run.stdout


def pixels_of(path):
    """RGBA of a flat file, float32."""
    buffer = oiio.ImageBuf(str(path))
    return buffer.get_pixels(oiio.FLOAT)[..., :4]


@pytest.mark.parametrize("compression", ["none", "zips"])
@pytest.mark.parametrize("merged", [False, True])
@pytest.mark.parametrize("pixel_type", ["half", "float"])
def test_every_sample_arrives_as_it_was(tmp_path, compression, merged, pixel_type):
    """Oracle: OpenImageIO's DeepData, value by value; half rounds as NumPy's float16 does."""
    band = deep_picture(9, 13)
    layout = ImageLayout(resolution=(13, 9), pixel_type=pixel_type)
    path = tmp_path / "a.exr"
    write_deep(path, band, layout=layout, merged=merged, compression=compression)
    file = oiio.ImageInput.open(str(path))
    assert file.spec().deep
    assert file.spec().getattribute("compression") == compression
    data = file.read_native_deep_image()
    file.close()
    names = [data.channelname(i) for i in range(data.channels)]
    assert names == ["R", "G", "B", "A", "Z", "ZBack"][: 5 + merged]
    types = [str(data.channeltype(i)) for i in range(data.channels)]
    assert types == [pixel_type] * 4 + ["float"] * (1 + merged)
    counts = [data.samples(i) for i in range(data.pixels)]
    assert counts == band.counts.ravel().tolist()
    color = band.color.astype(np.float16 if pixel_type == "half" else np.float32)
    expected = [*color.T, band.depth, band.depth_back][: len(names)]
    for channel, values in enumerate(expected):
        found = [
            data.deep_value(pixel, channel, sample)
            for pixel, count in enumerate(counts)
            for sample in range(count)
        ]
        np.testing.assert_array_equal(np.float32(found), values.astype(np.float32))


def test_oiiotool_flattens_to_the_samples_over_each_other(tmp_path):
    """Oracle: the over operator in float64, sample by sample; `oiiotool --flatten` as the peer."""
    band = deep_picture(12, 10)
    write_deep(tmp_path / "a.exr", band, compression="zips")
    oiiotool(tmp_path / "a.exr", "--flatten", "-d", "float", "-o", tmp_path / "flat.exr")
    np.testing.assert_allclose(pixels_of(tmp_path / "flat.exr"), flattened(band), atol=1e-6)


def test_two_pictures_merged_deep_are_all_their_samples_sorted(tmp_path):
    """Oracle: `oiiotool --deepmerge` then `--flatten`, beside a sort and the over operator."""
    one, two = deep_picture(8, 9, seed=1), deep_picture(8, 9, seed=2)
    write_deep(tmp_path / "1.exr", one)
    write_deep(tmp_path / "2.exr", two)
    merged = tmp_path / "merged.exr"
    oiiotool(tmp_path / "1.exr", tmp_path / "2.exr", "--deepmerge", "-o", merged)
    oiiotool(merged, "--flatten", "-d", "float", "-o", tmp_path / "flat.exr")
    pixels = [np.repeat(np.arange(72), band.counts.ravel()) for band in (one, two)]
    depth = np.concatenate([one.depth, two.depth])
    order = np.lexsort((depth, np.concatenate(pixels)))
    both = DeepBand(
        counts=one.counts + two.counts,
        depth=depth[order],
        depth_back=depth[order],
        color=np.concatenate([one.color, two.color])[order],
    )
    np.testing.assert_allclose(pixels_of(tmp_path / "flat.exr"), flattened(both), atol=1e-6)
    found = read_deep(merged)
    np.testing.assert_array_equal(found.depth, both.depth)
    np.testing.assert_array_equal(np.diff(found.offsets), both.counts.ravel())


def test_an_opaque_wall_holds_out_what_is_behind_it(tmp_path):
    """Oracle: `oiiotool --deepholdout`, beside leaving out the samples behind the wall."""
    band = deep_picture(8, 9)
    wall = DeepBand(
        counts=np.ones((8, 9), np.uint32),
        depth=np.full(72, 50, np.float32),
        depth_back=np.full(72, 50, np.float32),
        color=np.ones((72, 4), np.float32),
    )
    write_deep(tmp_path / "a.exr", band)
    write_deep(tmp_path / "wall.exr", wall)
    held, flat = tmp_path / "held.exr", tmp_path / "flat.exr"
    oiiotool(tmp_path / "a.exr", tmp_path / "wall.exr", "--deepholdout", "-o", held)
    oiiotool(held, "--flatten", "-d", "float", "-o", flat)
    is_near = band.depth < 50
    pixel = np.repeat(np.arange(72), band.counts.ravel())
    near = DeepBand(
        counts=np.bincount(pixel[is_near], minlength=72).reshape(8, 9).astype(np.uint32),
        depth=band.depth[is_near],
        depth_back=band.depth[is_near],
        color=band.color[is_near],
    )
    np.testing.assert_allclose(pixels_of(flat), flattened(near), atol=1e-6)


def test_windows_and_labels_are_in_the_header(tmp_path):
    """Oracle: `oiiotool --info -v`; overscan left, crop below."""
    layout = ImageLayout(
        resolution=(40, 30),
        data_window=(-6, -2, 45, 21),
        pixel_aspect_ratio=2.0,
        color_space="lin_ap1_scene",
        metadata={
            **picture_metadata(stage="shot.usd", frame=7.0, samples=4, exposure=0.5),
            "worldToCamera": tuple(float(i) for i in range(16)),
            "screenWindowWidth": 1.25,
            "usdsplat:a-name-that-is-longer-than-31-bytes": "é",
        },
    )
    write_deep(tmp_path / "a.exr", deep_picture(23, 51, most=9), layout=layout, merged=True)
    text = oiiotool("--info", "-v", tmp_path / "a.exr")
    for line in (
        "51 x   23, 6 channel, deep half/half/half/half/float/float openexr",
        "pixel data origin: x=-6, y=-2",
        "full/display size: 40 x 30",
        "full/display origin: 0, 0",
        'oiio:ColorSpace: "lin_ap1_scene"',
        'colorInteropID: "lin_ap1_scene"',
        "chromaticities: 0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767",
        "worldToCamera: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15",
        "screenWindowWidth: 1.25",
        "PixelAspectRatio: 2",
        "openexr:maxSamplesPerPixel: 9",
        'usdsplat:stage: "shot.usd"',
        "usdsplat:frame: 7",
        "usdsplat:samples: 4",
        "usdsplat:exposure: 0.5",
        "usdsplat:aov:ZBack: ",
        'usdsplat:a-name-that-is-longer-than-31-bytes: "é"',
        f'Software: "usdsplat {usdsplat.__version__}"',
    ):
        assert line in text


def test_bytes_do_not_depend_on_how_a_picture_is_cut_or_on_threads(tmp_path):
    """Oracle: the file written in one band by one thread, byte for byte."""
    band = deep_picture(130, 20)
    before = oiio.get_int_attribute("exr_threads")
    oiio.attribute("exr_threads", 1)
    write_deep(tmp_path / "one.exr", band, height=130, compression="zips")
    oiio.attribute("exr_threads", before)
    write_deep(tmp_path / "many.exr", band, height=9, compression="zips")
    assert (tmp_path / "one.exr").read_bytes() == (tmp_path / "many.exr").read_bytes()


def test_colour_beyond_half_is_its_largest_number(tmp_path):
    """Oracle: 65504 from IEEE 754."""
    band = DeepBand(
        counts=np.ones((1, 1), np.uint32),
        depth=np.ones(1, np.float32),
        depth_back=np.ones(1, np.float32),
        color=np.float32([[1e9, -np.inf, 3, 1]]),
    )
    write_deep(tmp_path / "a.exr", band, layout=ImageLayout(resolution=(1, 1)))
    np.testing.assert_array_equal(read_deep(tmp_path / "a.exr").color, [[65504, -65504, 3, 1]])


@pytest.mark.parametrize("compression", ["none", "zips"])
def test_ids_and_hashes_are_stored_as_they_are(tmp_path, compression):
    """As unsigned integers and as float, beside half colours; one layer of Cryptomatte. Oracle:
    OpenImageIO's DeepData, value by value, and the header as oiiotool reads it."""
    rng = np.random.default_rng(1)
    band = deep_picture(9, 13)
    n = len(band.depth)
    values = {
        "id": rng.integers(0, 2**32, n, dtype=np.uint32),
        "instanceId": np.full(n, 2**32 - 1, np.uint32),
        "splatId": np.arange(n, dtype=np.uint32),
    }
    for c in "RGBA":
        values[f"cryptoObject00.{c}"] = rng.normal(0, 1e9, n).astype(np.float32)
    aovs = ("color", "splatId", "cryptoObject", "id", "instanceId")
    layout = ImageLayout(resolution=(13, 9), compression=compression, aovs=aovs)
    path = tmp_path / "a.exr"
    with DeepWriter(path, layout, merged=True) as writer:
        writer.write_band(0, replace(band, ids=values))
    file = oiio.ImageInput.open(str(path))
    data = file.read_native_deep_image()
    file.close()
    names = [data.channelname(i) for i in range(data.channels)]
    assert sorted(names) == sorted(["R", "G", "B", "A", "Z", "ZBack", *values])
    for name, expected in values.items():
        channel = names.index(name)
        is_id = expected.dtype == np.uint32
        assert str(data.channeltype(channel)) == ("uint" if is_id else "float")
        get = data.deep_value_uint if is_id else data.deep_value
        found = [
            get(pixel, channel, sample)
            for pixel in range(data.pixels)
            for sample in range(data.samples(pixel))
        ]
        np.testing.assert_array_equal(np.array(found, expected.dtype), expected)
    text = oiiotool("--info", "-v", path)
    assert 'usdsplat:aov:id: "index in usdsplat:ids of the sample\'s prim"' in text
    assert 'usdsplat:aov:cryptoObject: "Cryptomatte of the sample: R = hash' in text
    np.testing.assert_array_equal(read_deep(path).depth, band.depth)


def test_ids_that_are_missing_or_of_another_type_are_refused(tmp_path):
    """Oracle: the type that the channel has."""
    band = deep_picture(4, 8)
    n = len(band.depth)
    layout = ImageLayout(resolution=(8, 4), aovs=("color", "id"))
    for ids, found in (
        ({}, "id: found nothing, expected uint32"),
        ({"id": np.zeros(n, np.int32)}, "id: found int32"),
    ):
        with (
            pytest.raises(ValueError, match=found),
            DeepWriter(tmp_path / "a.exr", layout) as writer,
        ):
            writer.write_band(0, replace(band, ids=ids))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixel_type": "uint8"}, "found uint8 pixels, expected half or float"),
        ({"color_space": "srgb_rec709_display"}, "srgb_rec709_display, expected a linear"),
        ({"color_space": "acescg"}, "output color space: found 'acescg'"),
        ({"compression": "zip"}, "compression 'zip', expected one of none, zips"),
    ],
)
def test_what_deep_exr_cannot_hold_is_refused_before_it_is_opened(change, message):
    """Oracle: one sentence, where: found X, expected Y."""
    with pytest.raises(UsageError, match=message):
        DeepWriter("a.exr", ImageLayout(**{"resolution": (8, 8), **change}))


@pytest.mark.parametrize(
    ("y0", "change", "message"),
    [
        (1, {}, "found rows 1 to 5, expected 0 on"),
        (0, {"counts": np.zeros((4, 7), np.uint32)}, r"counts: found uint32\(4, 7\)"),
        (0, {"counts": np.zeros((4, 8), np.int32)}, r"counts: found int32\(4, 8\)"),
        (0, {"counts": np.zeros((4, 8), np.uint32)}, "found 32 samples, expected 0"),
        (0, {"color": np.zeros((32, 3), np.float32)}, r"color: found float32\(32, 3\)"),
        (0, {"depth_back": np.zeros(31, np.float32)}, r"depth_back: found float32\(31,\)"),
    ],
)
def test_bands_that_do_not_fit_are_refused(tmp_path, y0, change, message):
    """Oracle: the shapes and dtypes that `DeepBand` promises."""
    fields = {
        "counts": np.ones((4, 8), np.uint32),
        "depth": np.ones(32, np.float32),
        "depth_back": np.ones(32, np.float32),
        "color": np.ones((32, 4), np.float32),
    }
    band = DeepBand(**{**fields, **change})
    with DeepWriter(tmp_path / "a.exr", ImageLayout(resolution=(8, 4))) as writer:
        with pytest.raises(ValueError, match=message):
            writer.write_band(y0, band)
        writer.write_band(0, DeepBand(**fields))


def test_samples_out_of_order_are_refused(tmp_path):
    """Oracle: near to far within a pixel; from one pixel to the next depth may fall."""
    counts = np.uint32([[2, 2]])
    ones = np.ones((4, 4), np.float32)
    for depth, is_fine in (([1, 5, 2, 2], True), ([1, 5, 3, 2], False)):
        z = np.float32(depth)
        band = DeepBand(counts=counts, depth=z, depth_back=z, color=ones)
        if is_fine:
            write_deep(tmp_path / "a.exr", band)
        else:
            with pytest.raises(ValueError, match="row 0: found samples out of order"):
                write_deep(tmp_path / "b.exr", band)
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_a_failure_leaves_the_older_file_and_nothing_else(tmp_path):
    """Oracle: the folder before; rows that are missing, and an interrupted render."""
    (tmp_path / "a.exr").write_bytes(b"older")
    layout = ImageLayout(resolution=(10, 12))
    band = deep_picture(5, 10)
    with (
        pytest.raises(ValueError, match="found rows to 5, expected 12"),
        DeepWriter(tmp_path / "a.exr", layout) as writer,
    ):
        writer.write_band(0, band)
    with pytest.raises(KeyboardInterrupt), DeepWriter(tmp_path / "a.exr", layout) as writer:
        writer.write_band(0, band)
        raise KeyboardInterrupt
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]
    assert (tmp_path / "a.exr").read_bytes() == b"older"


def test_a_full_disk_is_one_sentence(tmp_path):
    """Oracle: the folder, empty as before, and a sentence that names the file."""
    band = deep_picture(40, 40)
    with small_disk(), pytest.raises(OutputError, match=r"a\.exr: found File too large"):
        write_deep(tmp_path / "a.exr", band)
    assert list(tmp_path.iterdir()) == []


BIG = """
import resource, sys, numpy as np
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.layout import ImageLayout
w, h, rows, k = 1920, 400, 8, 10
n = rows * w * k
z = np.tile(np.arange(k, dtype=np.float32), rows * w)
band = DeepBand(counts=np.full((rows, w), k, np.uint32), depth=z, depth_back=z,
                color=np.ones((n, 4), np.float32))
with DeepWriter(sys.argv[1], ImageLayout(resolution=(w, h))) as out:
    out.write_band(0, band)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for y in range(rows, h, rows):
        out.write_band(y, band)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def test_memory_holds_a_band_however_large_the_picture(tmp_path):
    """Oracle: peak memory of a process; the samples of this picture are 92 MB in the file."""
    argv = [sys.executable, "-c", BIG, str(tmp_path / "big.exr")]
    run = subprocess.run(argv, capture_output=True, text=True, check=True)
    assert run.stderr == ""
    assert int(run.stdout) < 20_000  # kB
