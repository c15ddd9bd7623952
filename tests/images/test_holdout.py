"""Tests of reading pictures of other renderers as holdouts."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.images.test_deep import deep_picture, write_deep
from tests.images.test_deep_reader import written_by_openimageio
from tests.images.test_exr import picture, write
from usdsplat.core.errors import FormatError, UsageError
from usdsplat.images import holdout_nodes
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.holdout import open_holdout
from usdsplat.images.layout import ImageLayout
from usdsplat.kernels import reference_rays
from usdsplat.kernels.walk import held_through

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


def test_pixels_with_opacity_but_no_depth_are_counted(tmp_path):
    """Oracle: the values, by eye; without A, nothing says that something is there."""
    z = np.float32([[np.inf, np.nan, 0, -1, 5, np.inf, np.inf]])
    alpha = np.float32([[1, 0.5, 0.1, 1, 1, 0, np.nan]])
    flat(tmp_path / "a.exr", {"A": alpha, "Z": z}, full=(7, 1))
    assert open_holdout(tmp_path / "a.exr", resolution=(7, 1)).without_depth == 4
    flat(tmp_path / "b.exr", {"Z": z}, full=(7, 1))
    assert open_holdout(tmp_path / "b.exr", resolution=(7, 1)).without_depth == 0


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


def samples_of(band):
    """(column, row) -> front, back and opacity of the samples, each an array"""
    ends = np.cumsum(band.counts.ravel())
    values = np.stack([band.depth, band.depth_back, band.color[:, 3]]).astype(np.float64)
    columns = band.counts.shape[1]
    return {
        (pixel % columns, pixel // columns): values[:, end - count : end]
        for pixel, (end, count) in enumerate(zip(ends, band.counts.ravel(), strict=True))
    }


def compare_deep(rows, image, origin, window):
    """Against the product over the samples of `image`, around and within all of them."""
    x0, y0, x1, y1 = window
    offsets, depths, through = rows
    assert len(offsets) == (x1 - x0) * (y1 - y0) + 1
    assert depths.dtype == through.dtype == np.float32
    error = []
    for pixel, (y, x) in enumerate((y, x) for y in range(y0, y1) for x in range(x0, x1)):
        samples = image.get((x - origin[0], y - origin[1]), np.zeros((3, 0)))
        assert offsets[pixel + 1] - offsets[pixel] == 2 * samples.shape[1]
        ends = np.sort(samples[:2].ravel())
        probes = np.concatenate([[0.5], ends, ends + 1e-3, (ends[1:] + ends[:-1]) / 2, [200]])
        for probe in np.unique(probes.astype(np.float32)):
            expected = reference_rays.held_through(*samples, np.float64(probe))
            error.append(held_through(offsets, depths, through, pixel, probe) - expected)
    assert np.abs(error).max() < 2e-4
    assert 10 * np.log10(1 / max(np.mean(np.square(error)), 1e-30)) > 80


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
def test_deep_samples_attenuate_within_their_extents(tmp_path, tile, window):
    """Oracle: the reference's product over samples in float64; half opacities."""
    band = deep_picture(11, 13)
    color = band.color.astype(np.float16).astype(np.float32)
    back = band.depth + np.float32(20) * (np.arange(len(band.depth)) % 3 > 0)  # they overlap
    band = DeepBand(
        counts=band.counts, depth=band.depth, depth_back=back.astype(np.float32), color=color
    )
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips", tile=tile)
    rows = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(*window)
    compare_deep(rows, samples_of(band), (-3, 5), window)


@pytest.mark.parametrize("tile", [None, (8, 4), (64, 64)])
def test_the_fullest_rows_are_known_before_they_are_read(tmp_path, tile):
    """Oracle: two nodes for each sample of a row, or of the rows of a tile."""
    band = deep_picture(11, 13)
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips", tile=tile)
    rows = min(tile[1], 11) if tile else 1
    most = max(band.counts[y : y + rows].sum() for y in range(0, 11, rows))
    assert open_holdout(tmp_path / "a.exr", resolution=SIZE).nodes == 2 * most / (13 * rows)


def test_strips_of_a_deep_file_join(tmp_path, monkeypatch):
    """Oracle: all rows as one strip, bit for bit."""
    band = deep_picture(11, 13)
    written_by_openimageio(tmp_path / "a.exr", band, compression="zips")
    whole = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(0, 0, 64, 48)
    monkeypatch.setattr(holdout_nodes, "STRIP", 3)
    joined = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(0, 0, 64, 48)
    for found, expected in zip(joined, whole, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_samples_in_any_order_are_sorted(tmp_path):
    """Oracle: the reference's product, which has no order; OpenImageIO writes them as they come."""
    band = deep_picture(11, 13, most=5)
    rng = np.random.default_rng(3)
    pixel = np.repeat(np.arange(143), band.counts.ravel())
    order = np.lexsort((rng.random(len(pixel)), pixel))
    color = band.color.astype(np.float16).astype(np.float32)[order]
    depth = band.depth[order]
    band = DeepBand(counts=band.counts, depth=depth, depth_back=depth, color=color)
    written_by_openimageio(tmp_path / "a.exr", band, compression="none")
    rows = open_holdout(tmp_path / "a.exr", resolution=SIZE).rows(0, 0, 64, 48)
    compare_deep(rows, samples_of(band), (-3, 5), (0, 0, 64, 48))


def test_nothing_at_or_behind_the_camera_hides(tmp_path):
    """Without extent, behind, across and from the camera on; opaque ones too. Oracle: the rule for
    points; for extents, what the reference says of the whole sample in front of a depth, relative
    to what it says in front of the camera; a flat file of the same depths."""
    front = np.float32([0, -2, -5, -5, -1, 0, -1, 3, -3])
    back = np.float32([0, -2, -1, 0, 4, 4, 7, 3, np.inf])
    alpha = np.float32([0.5, 0.5, 0.5, 0.5, 0.75, 0.5, 1, 0.25, 0.5])
    color = np.stack([alpha] * 4, axis=1)
    band = DeepBand(counts=np.ones((1, 9), np.uint32), depth=front, depth_back=back, color=color)
    layout = ImageLayout(resolution=(9, 1), pixel_type="float")
    with DeepWriter(tmp_path / "a.exr", layout, merged=True) as writer:
        writer.write_band(0, band)
    nodes = open_holdout(tmp_path / "a.exr", resolution=(9, 1)).rows(0, 0, 9, 1)
    depths = np.array([0.01, 1.0, 3.5, 5.0])
    for pixel in range(9):
        found = [held_through(*nodes, pixel, np.float32(depth)) for depth in depths]
        expected = np.ones(4)
        if pixel in (4, 5, 7):
            sample = [each[pixel : pixel + 1].astype(np.float64) for each in (front, back, alpha)]
            expected = reference_rays.held_through(*sample, depths)
            expected /= reference_rays.held_through(*sample, np.zeros(1))
        if pixel == 6:
            expected = np.zeros(4)
        np.testing.assert_allclose(found, expected, atol=1e-6, err_msg=str(pixel))
    points = [0, 1, 7]
    flat(tmp_path / "f.exr", {"A": alpha[None, points], "Z": front[None, points]}, full=(3, 1))
    opaque, edges = open_holdout(tmp_path / "f.exr", resolution=(3, 1)).rows(0, 0, 3, 1)
    assert np.isinf(opaque).all()
    for i, pixel in enumerate(points):
        for depth in np.float32(depths):
            assert held_through(*edges, i, depth) == held_through(*nodes, pixel, depth)


def test_ours_without_zback_holds_out(tmp_path):
    """Oracle: the reference's product over samples in float64."""
    band = deep_picture(6, 8)
    write_deep(tmp_path / "a.exr", band, compression="zips")
    rows = open_holdout(tmp_path / "a.exr", resolution=(8, 6)).rows(0, 0, 8, 6)
    points = DeepBand(counts=band.counts, depth=band.depth, depth_back=band.depth, color=band.color)
    compare_deep(rows, samples_of(points), (0, 0), (0, 0, 8, 6))


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
