"""Tests of reading pictures of other renderers as holdouts."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.images.test_deep import deep_picture, write_deep
from tests.images.test_deep_reader import written_by_openimageio
from tests.images.test_exr import picture, write
from usdsplat.core.errors import FormatError, UsageError
from usdsplat.images.deep import DeepBand
from usdsplat.images.holdout import open_holdout
from usdsplat.images.layout import ImageLayout

SIZE = (64, 48)


def flat(path, channels, *, origin=(0, 0), full=SIZE, tile=0, pixel_type="float"):
    """A flat EXR by OpenImageIO; `channels` is name -> array of shape (rows, columns)."""
    rows, columns = next(iter(channels.values())).shape
    spec = oiio.ImageSpec(columns, rows, len(channels), pixel_type)
    spec.channelnames = tuple(channels)
    spec.x, spec.y = origin
    spec.full_width, spec.full_height = full
    spec.full_x = spec.full_y = 0
    spec.tile_width = spec.tile_height = tile
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(spec.roi, np.stack(list(channels.values()), axis=2))
    assert buffer.write(str(path)), buffer.geterror()


def depths(rows, columns, seed=0):
    """Random depths."""
    return np.random.default_rng(seed).uniform(1, 9, (rows, columns)).astype(np.float32)


@pytest.mark.parametrize("tile", [0, 16])
@pytest.mark.parametrize("name", ["Z", "depth.Z", "depth", "cg.Z"])
def test_depth_is_found_by_position_whatever_its_window(tmp_path, name, tile):
    """Oracle: the array that was written; a window that hangs over the picture's left edge."""
    z = depths(20, 50)
    flat(tmp_path / "a.exr", {"B": z * 2, name: z}, origin=(-10, 7), tile=tile)
    holdout = open_holdout(tmp_path / "a.exr", resolution=SIZE)
    expected = np.full((48, 64), np.inf, np.float32)
    expected[7:27, :40] = z[:, 10:]
    np.testing.assert_array_equal(holdout.rows(0, 0, 64, 48), expected)
    np.testing.assert_array_equal(holdout.rows(3, 20, 60, 25), expected[20:25, 3:60])
    np.testing.assert_array_equal(holdout.rows(-20, 10, -5, 11)[0, 10:], z[3, :5])
    assert np.isinf(holdout.rows(0, 30, 64, 40)).all()


def test_depth_counts_only_where_something_is(tmp_path):
    """Oracle: the rule; background is A = 0, or a depth that is nowhere in front of the eye."""
    z = np.float32([[5, 5, 5, 0, -1, np.nan, np.inf, 1e30]])
    alpha = np.float32([[1, 2, 0, 1, 0.5, 1, 1, 1]])
    flat(tmp_path / "a.exr", {"A": alpha, "Z": z}, full=(8, 1))
    found = open_holdout(tmp_path / "a.exr", resolution=(8, 1)).rows(0, 0, 8, 1)
    inf = np.inf
    np.testing.assert_array_equal(found, np.float32([[5, 5, inf, inf, inf, inf, inf, 1e30]]))


def test_an_edge_lets_a_part_through(tmp_path):
    """Oracle: the rule, 1 - A behind the depth, in each window alike; all but one pixel are opaque
    or empty."""
    z = depths(300, 9)
    alpha = np.ones((300, 9), np.float32)
    alpha[290, 4] = 0.25
    alpha[7] = 0
    alpha[8, 3] = np.nan
    flat(tmp_path / "a.exr", {"A": alpha, "Z": z}, full=(9, 300))
    holdout = open_holdout(tmp_path / "a.exr", resolution=(9, 300))
    for window in ((0, 0, 9, 300), (2, 5, 7, 10), (-3, 289, 6, 292)):
        x0, y0, x1, y1 = window
        places = [(x, y) for y in range(y0, y1) for x in range(x0, x1)]
        opaque, edges = holdout.rows(*window)
        depth = [z[y, x] if x >= 0 and alpha[y, x] == 1 else np.inf for x, y in places]
        np.testing.assert_array_equal(opaque.ravel(), depth)
        compare(edges, [[(z[290, 4], 0.75)] if place == (4, 290) else [] for place in places])


@pytest.mark.parametrize("multipart", [False, True])
def test_our_own_pictures_hold_out(tmp_path, multipart):
    """Oracle: the depths that were written, in either kind of file."""
    layout = ImageLayout(resolution=SIZE, aovs=("color", "Z"), multipart=multipart)
    pixels = picture(48, 64)
    pixels["color"][..., 3] = 1
    write(tmp_path / "a.exr", layout, pixels)
    holdout = open_holdout(tmp_path / "a.exr", resolution=SIZE)
    np.testing.assert_array_equal(holdout.rows(0, 5, 64, 48), pixels["Z"][5:])


def expected_rows(image, origin, window):
    """What a window holds, pixel by pixel: [(depth, transmittance), ...] from a dictionary."""
    x0, y0, x1, y1 = window
    found = []
    for y in range(y0, y1):
        for x in range(x0, x1):
            passed, samples = 1.0, []
            for depth, alpha in sorted(image.get((x - origin[0], y - origin[1]), [])):
                passed *= 1 - alpha
                samples.append((depth, passed))
            found.append(samples)
    return found


def samples_of(band, *, merged):
    """(column, row) -> [(depth, alpha), ...]"""
    found, at = {}, 0
    middle = (band.depth + band.depth_back) / 2 if merged else band.depth
    for pixel, count in enumerate(band.counts.ravel().tolist()):
        part = slice(at, at + count)
        place = pixel % band.counts.shape[1], pixel // band.counts.shape[1]
        found[place] = list(zip(middle[part].tolist(), band.color[part, 3].tolist(), strict=True))
        at += count
    return found


def compare(rows, expected):
    """Against what pixel by pixel was expected."""
    offsets, depth, passed = rows
    assert np.diff(offsets).tolist() == [len(samples) for samples in expected]
    assert depth.dtype == passed.dtype == np.float32
    flat_list = [sample for samples in expected for sample in samples]
    pairs = np.array(flat_list, np.float64).reshape(-1, 2)
    np.testing.assert_allclose(depth, pairs[:, 0], rtol=1e-6)
    np.testing.assert_allclose(passed, pairs[:, 1], atol=1e-6)


WINDOWS = [(0, 0, 64, 48), (2, 6, 9, 14), (-3, 5, 10, 16), (-9, 0, 2, 8), (20, 0, 30, 48)]


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("tile", [None, (8, 4)])
def test_deep_samples_let_through_what_they_do_not_cover(tmp_path, tile, window):
    """Oracle: products pixel by pixel in float64; a ZBack counts half way; half opacities."""
    band = deep_picture(11, 13)
    color = band.color.astype(np.float16).astype(np.float32)
    band = DeepBand(counts=band.counts, depth=band.depth, depth_back=band.depth_back, color=color)
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips", tile=tile)
    rows = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(*window)
    compare(rows, expected_rows(samples_of(band, merged=True), (-3, 5), window))


def test_samples_in_any_order_are_sorted(tmp_path):
    """Oracle: a sort of each pixel's samples; OpenImageIO writes them as they come."""
    band = deep_picture(11, 13, most=5)
    rng = np.random.default_rng(3)
    pixel = np.repeat(np.arange(143), band.counts.ravel())
    order = np.lexsort((rng.random(len(pixel)), pixel))
    color = band.color.astype(np.float16).astype(np.float32)[order]
    depth = band.depth[order]
    band = DeepBand(counts=band.counts, depth=depth, depth_back=depth, color=color)
    written_by_openimageio(tmp_path / "a.exr", band, compression="none")
    rows = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(0, 0, 64, 48)
    compare(rows, expected_rows(samples_of(band, merged=False), (-3, 5), (0, 0, 64, 48)))


def test_samples_that_are_nowhere_hide_nothing(tmp_path):
    """Oracle: the rule for NaN, and opacity kept within 0..1."""
    depth = np.float32([2, 1, np.nan, 3, 4])
    alpha = np.float32([0.5, np.nan, 1, 7, -1])
    band = DeepBand(
        counts=np.uint32([[5]]),
        depth=depth,
        depth_back=depth,
        color=np.stack([alpha] * 4, axis=1),
    )
    written_by_openimageio(tmp_path / "a.exr", band, compression="none")
    _, found, passed = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(-3, 5, -2, 6)
    assert found.tolist() == [1, 2, 3, 4, np.inf]
    assert passed.tolist() == [1, 0.5, 0, 0, 0]


def test_ours_without_zback_holds_out(tmp_path):
    """Oracle: products pixel by pixel in float64."""
    band = deep_picture(6, 8)
    write_deep(tmp_path / "a.exr", band, compression="zips")
    rows = open_holdout(tmp_path / "a.exr", resolution=(8, 6)).rows(0, 0, 8, 6)
    compare(rows, expected_rows(samples_of(band, merged=False), (0, 0), (0, 0, 8, 6)))


def test_what_cannot_hold_out_is_one_sentence(tmp_path):
    """Oracle: one sentence, where: found X, expected Y; nothing on stderr at exit."""
    with pytest.raises(UsageError, match=r"none\.exr: found no such file"):
        open_holdout(tmp_path / "none.exr", resolution=SIZE)
    (tmp_path / "text.exr").write_text("not a picture")
    with pytest.raises(FormatError, match=r"text\.exr: found .+, expected an EXR with depth"):
        open_holdout(tmp_path / "text.exr", resolution=SIZE)
    flat(tmp_path / "rgb.exr", {"R": depths(48, 64)})
    with pytest.raises(FormatError, match=r"found channels R, expected one of Z, depth\.Z, depth"):
        open_holdout(tmp_path / "rgb.exr", resolution=SIZE)
    assert oiio.geterror() == ""


@pytest.mark.parametrize("is_deep", [False, True])
def test_another_display_window_is_refused(tmp_path, is_deep):
    """Oracle: the sentence, with both sizes."""
    if is_deep:
        write_deep(tmp_path / "a.exr", deep_picture(6, 8))
    else:
        flat(tmp_path / "a.exr", {"Z": depths(6, 8)}, full=(8, 6))
    with pytest.raises(UsageError, match="found a display window of 8x6 at 0, 0, expected 64x48"):
        open_holdout(tmp_path / "a.exr", resolution=SIZE)


def test_damaged_pixels_are_one_sentence(tmp_path):
    """Oracle: the sentence; the header is whole, the rows are not."""
    flat(tmp_path / "a.exr", {"Z": depths(48, 64)})
    data = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(data[: len(data) // 2])
    holdout = open_holdout(tmp_path / "a.exr", resolution=SIZE)
    with pytest.raises(FormatError, match=r"a\.exr: found .+, expected a complete EXR file"):
        holdout.rows(0, 0, 64, 48)
