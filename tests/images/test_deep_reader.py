"""Tests of reading deep files of other writers, and errors for damaged ones."""

from __future__ import annotations

import random
import struct
import zlib
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.images.test_deep import deep_picture, write_deep
from usdsplat.core.errors import FormatError
from usdsplat.images.deep_reader import DeepFile, read_deep
from usdsplat.images.exr_bytes import unpacked, zipped

NAMES = ("R", "G", "B", "A", "Z", "ZBack")


def written_by_openimageio(path, band, *, compression, tile=None, names=NAMES, parts=1):
    """A deep file that OpenImageIO made, value by value."""
    rows, columns = band.counts.shape
    spec = oiio.ImageSpec(columns, rows, len(names), "float")
    spec.channelnames = names
    spec.channelformats = ("half",) * (len(names) - 2) + ("float",) * 2
    spec.deep = True
    spec.attribute("compression", compression)
    spec.x, spec.y = -3, 5
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 64, 48
    if tile:
        spec.tile_width, spec.tile_height = tile
    data = oiio.DeepData()
    data.init(spec)
    source = dict(zip(NAMES, [*band.color.T, band.depth, band.depth_back], strict=True))
    at = 0
    for pixel, count in enumerate(band.counts.ravel().tolist()):
        data.set_samples(pixel, count)
        for sample in range(count):
            for channel, name in enumerate(names):
                data.set_deep_value(pixel, channel, sample, float(source[name][at + sample]))
        at += count
    file = oiio.ImageOutput.create(str(path))
    specs = [oiio.ImageSpec(spec) for _ in range(parts)]
    for i, each in enumerate(specs):
        each.attribute("oiio:subimagename", f"part{i}")
    assert file.open(str(path), tuple(specs)), file.geterror()
    for i, each in enumerate(specs):
        assert i == 0 or file.open(str(path), each, "AppendSubimage"), file.geterror()
        assert file.write_deep_image(data), file.geterror()
    assert file.close()


@pytest.mark.parametrize("compression", ["none", "rle", "zips"])
@pytest.mark.parametrize("tile", [None, (8, 4), (64, 64)])
def test_what_openimageio_wrote_is_read(tmp_path, compression, tile):
    """Oracle: the values that OpenImageIO was given; whole tiles, cut ones, and rows."""
    band = deep_picture(11, 13)
    written_by_openimageio(tmp_path / "a.exr", band, compression=compression, tile=tile)
    image = read_deep(tmp_path / "a.exr")
    assert image.window == (-3, 5, 10, 16)
    assert image.display_window == (0, 0, 64, 48)
    np.testing.assert_array_equal(np.diff(image.offsets), band.counts.ravel())
    np.testing.assert_array_equal(image.depth, band.depth)
    np.testing.assert_array_equal(image.depth_back, band.depth_back)
    np.testing.assert_array_equal(image.color, band.color.astype(np.float16))


@pytest.mark.parametrize("tile", [None, (8, 4)])
def test_some_rows_are_those_of_the_whole(tmp_path, tile):
    """Oracle: the whole picture; rows begin and end inside tiles."""
    band = deep_picture(11, 13)
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips", tile=tile)
    whole = read_deep(tmp_path / "a.exr")
    with DeepFile(tmp_path / "a.exr") as file:
        offsets, arrays = file.rows(7, 14, ("A", "Z", "none such"))
    assert arrays.keys() == {"A", "Z"}
    part = slice(whole.offsets[2 * 13], whole.offsets[9 * 13])
    np.testing.assert_array_equal(offsets, whole.offsets[2 * 13 : 9 * 13 + 1] - part.start)
    np.testing.assert_array_equal(arrays["Z"], whole.depth[part])
    np.testing.assert_array_equal(arrays["A"], whole.color[part, 3])


@pytest.mark.parametrize("columns", [(-3, 10), (-1, 4), (5, 6), (6, 10), (-3, -2)])
@pytest.mark.parametrize("tile", [None, (8, 4), (3, 5)])
def test_some_columns_are_those_of_the_whole(tmp_path, tile, columns):
    """Oracle: the whole picture, pixel by pixel."""
    band = deep_picture(11, 13)
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips", tile=tile)
    whole = read_deep(tmp_path / "a.exr")
    with DeepFile(tmp_path / "a.exr") as file:
        offsets, arrays = file.rows(7, 14, ("Z",), columns=columns)
    pixels = [13 * (y - 5) + x + 3 for y in range(7, 14) for x in range(*columns)]
    expected = [whole.depth[whole.offsets[k] : whole.offsets[k + 1]] for k in pixels]
    assert np.diff(offsets).tolist() == [len(each) for each in expected]
    np.testing.assert_array_equal(arrays["Z"], np.concatenate(expected))


def test_of_many_deep_parts_the_first_is_read(tmp_path):
    """Oracle: the values that OpenImageIO was given; chunks name their parts there."""
    band = deep_picture(11, 13)
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips", parts=2)
    assert b"part1" in (tmp_path / "a.exr").read_bytes()
    image = read_deep(tmp_path / "a.exr")
    np.testing.assert_array_equal(image.depth, band.depth)


def test_ours_is_read_as_it_was_written(tmp_path):
    """Oracle: the samples; without ZBack a sample ends where it starts."""
    band = deep_picture(9, 13)
    for merged, back in ((True, band.depth_back), (False, band.depth)):
        write_deep(tmp_path / "a.exr", band, merged=merged, compression="zips")
        image = read_deep(tmp_path / "a.exr")
        np.testing.assert_array_equal(image.depth, band.depth)
        np.testing.assert_array_equal(image.depth_back, back)
        np.testing.assert_array_equal(image.color, band.color)


def test_a_picture_without_samples_is_read(tmp_path):
    """Oracle: zero samples in every pixel, as it was written."""
    band = deep_picture(4, 5, most=0)
    write_deep(tmp_path / "a.exr", band, compression="zips")
    image = read_deep(tmp_path / "a.exr")
    assert image.offsets.tolist() == [0] * 21
    assert image.color.shape == (0, 4)


@pytest.mark.parametrize("size", [0, 1, 2, 3, 1000, 4097])
def test_zip_undoes_itself(size):
    """Oracle: the bytes; smooth ones, which shrink, and noise, which is kept as it is."""
    smooth = bytes(i // 7 % 256 for i in range(size))
    noise = random.Random(size).randbytes(size)
    for raw in (smooth, noise):
        assert unpacked(zipped(raw), size, 2, "a") == raw


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no EXR"),
        (b"PNG or so, not EXR", "no EXR"),
        (struct.pack("<iI", 20000630, 2), "0 bytes where 1 should be"),
        (struct.pack("<iI", 20000630, 2) + b"x" * 999, "an unterminated name"),
        (struct.pack("<iI", 20000630, 2) + b"\0", "no deep part"),
        (struct.pack("<iI", 20000630, 2) + b"a\0b\0\xff\xff\xff\x7f", "bytes where 2147483647"),
    ],
)
def test_what_is_no_deep_file_is_one_sentence(tmp_path, data, words):
    """Oracle: the sentence."""
    (tmp_path / "a.exr").write_bytes(data)
    with pytest.raises(FormatError, match=words):
        read_deep(tmp_path / "a.exr")


def test_flat_files_and_those_without_depth_are_one_sentence(tmp_path):
    """Oracle: the sentence, which names what is there."""
    flat = oiio.ImageBuf(oiio.ImageSpec(4, 4, 3, "half"))
    flat.write(str(tmp_path / "flat.exr"))
    with pytest.raises(FormatError, match=r"flat\.exr: found no deep part"):
        read_deep(tmp_path / "flat.exr")
    names = ("R", "G", "B")
    written_by_openimageio(tmp_path / "b.exr", deep_picture(3, 4), compression="none", names=names)
    with pytest.raises(FormatError, match="found channels B, G, R, expected Z and A among them"):
        read_deep(tmp_path / "b.exr")


def test_counts_are_not_believed_beyond_what_the_file_holds(tmp_path):
    """Oracle: two billion samples promised in a row of a file of 1 kB are one sentence."""
    band = deep_picture(2, 2, most=1)
    path = tmp_path / "a.exr"
    write_deep(path, band)
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack("<iQ", 0, 8), len(data) - 200)
    data[at + 28 : at + 36] = struct.pack("<ii", 2**31 - 2, 2**31 - 1)
    path.write_bytes(data)
    with pytest.raises(FormatError, match="invalid sample counts"):
        read_deep(path)
    size = (2**31 - 1) * 20
    data[at + 20 : at + 28] = struct.pack("<Q", size)
    path.write_bytes(data)
    with pytest.raises(FormatError, match="invalid sample counts"):
        read_deep(path)


@pytest.mark.parametrize("compression", ["none", "rle", "zips"])
def test_sizes_are_not_believed_beyond_what_packed_bytes_can_hold(tmp_path, compression):
    """Oracle: a size of 2^60 in a chunk's header is one sentence; that of equal samples, which are
    packed as small as can be, is right."""
    band = deep_picture(3, 200, most=50)
    same = replace(band, depth=np.ones_like(band.depth), depth_back=np.ones_like(band.depth))
    same = replace(same, color=np.zeros_like(band.color))
    path = tmp_path / "a.exr"
    written_by_openimageio(path, same, compression=compression)
    with DeepFile(path) as file:
        assert file.samples_by_band() == band.counts.sum(axis=1).tolist()
        chunk = file._chunks[1]
    data = bytearray(path.read_bytes())
    data[chunk + 20 : chunk + 28] = struct.pack("<Q", 2**60)
    path.write_bytes(data)
    with DeepFile(path) as file, pytest.raises(FormatError, match="invalid sample counts"):
        file.samples_by_band()


def test_a_stream_that_inflates_without_end_is_stopped():
    """Oracle: 64 MB of zeros in 64 kB, where 10 bytes should be."""
    with pytest.raises(FormatError, match="cannot be unpacked"):
        unpacked(zlib.compress(bytes(2**26)), 10, 2, "a")


@pytest.mark.parametrize("tile", [None, (8, 4)])
@pytest.mark.parametrize("compression", ["none", "rle", "zips"])
def test_damage_is_a_sentence_or_other_samples_but_never_a_crash(tmp_path, tile, compression):
    """Oracle: every error is ours; 150 files cut short or with some bytes changed."""
    path = tmp_path / "a.exr"
    written_by_openimageio(path, deep_picture(5, 9), compression=compression, tile=tile)
    whole = path.read_bytes()
    rng = random.Random(1)
    failed = 0
    for i in range(150):
        data = bytearray(whole)
        if i % 5 == 0:
            del data[rng.randrange(len(data)) :]
        for _ in range(rng.randrange(1, 4) if data else 0):
            data[rng.randrange(len(data))] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        path.write_bytes(data)
        try:
            image = read_deep(path)
        except FormatError:
            failed += 1
        else:
            assert image.offsets[-1] == len(image.depth) == len(image.color)
    assert failed > 20
