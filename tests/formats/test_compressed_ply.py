"""Tests of PlayCanvas's compressed PLY: files of chosen words, decoded one number at a time."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.formats.compare import differences
from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core import morton
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.formats.options import ReadOptions, WriteOptions

BOUNDS = [f"{side}_{axis}" for side in ("min", "max") for axis in "xyz"]
BOUNDS += [f"{side}_scale_{axis}" for side in ("min", "max") for axis in "xyz"]
COLOR_BOUNDS = [f"{side}_{channel}" for side in ("min", "max") for channel in "rgb"]
WORDS = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


def make(
    count: int, *, colored: bool = True, rest: int = 0, seed: int = 3
) -> dict[str, np.ndarray]:
    """Random chunks, words and harmonics."""
    rng = np.random.default_rng(seed)
    names = BOUNDS + COLOR_BOUNDS * colored
    chunk = np.zeros(-(-count // 256), [(name, "f4") for name in names])
    for name in names:
        chunk[name] = rng.uniform(-3, -1, len(chunk)) + 2.5 * name.startswith("max")
    vertex = np.zeros(count, [(name, "u4") for name in WORDS])
    for name in WORDS:
        vertex[name] = rng.integers(0, 2**32, count)
    elements = {"chunk": chunk, "vertex": vertex}
    if rest:
        elements["sh"] = np.zeros(count, [(f"f_rest_{i}", "u1") for i in range(rest)])
        for name in elements["sh"].dtype.names:
            elements["sh"][name] = rng.integers(0, 256, count)
    return elements


def save(path, elements, *, text=False, order="<"):
    from plyfile import PlyData, PlyElement

    described = [PlyElement.describe(rows, name) for name, rows in elements.items()]
    PlyData(described, text=text, byte_order="=" if text else order).write(path)
    return path


def expected(elements, row):
    """Position, scale, rotation, opacity and harmonics of a splat, by formats.md section 2.2."""
    chunk = elements["chunk"][row // 256]
    place, turn, size, paint = (int(elements["vertex"][name][row]) for name in WORDS)

    def lerp(name, code, top):
        t = code / top
        has = f"min_{name}" in chunk.dtype.names
        low, high = (float(chunk[f"{side}_{name}"]) if has else None for side in ("min", "max"))
        return low * (1 - t) + high * t if has else t

    def split(word):
        return word >> 21, (word >> 11) & 1023, word & 2047

    tops = (2047, 1023, 2047)
    position = [lerp(a, c, top) for a, c, top in zip("xyz", split(place), tops, strict=True)]
    logs = [lerp(f"scale_{a}", c, top) for a, c, top in zip("xyz", split(size), tops, strict=True)]
    small = [((turn >> shift & 1023) / 1023 - 0.5) * math.sqrt(2) for shift in (20, 10, 0)]
    quaternion = list(small)
    quaternion.insert(turn >> 30, math.sqrt(max(0, 1 - sum(v * v for v in small))))
    length = math.sqrt(sum(v * v for v in quaternion))
    rgb = [lerp(c, paint >> shift & 255, 255) for c, shift in zip("rgb", (24, 16, 8), strict=True)]
    sh = [[(v - 0.5) / 0.28209479177387814 for v in rgb]]
    rest = len(elements["sh"].dtype.names) if "sh" in elements else 0
    for k in range(rest // 3):
        codes = [int(elements["sh"][f"f_rest_{c * rest // 3 + k}"][row]) for c in range(3)]
        unit = [0 if q == 0 else 1 if q == 255 else (q + 0.5) / 256 for q in codes]
        sh.append([(n - 0.5) * 8 for n in unit])
    scale = [math.exp(v) for v in logs]
    return position, scale, [v / length for v in quaternion], (paint & 255) / 255, sh


@pytest.mark.parametrize("rest", [0, 9, 24, 45, 72])
@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize(("text", "order"), [(False, "<"), (False, ">"), (True, "=")])
def test_words_decode_as_the_layout_says(tmp_path, rest, colored, text, order):
    """Oracle: the layout of formats.md 2.2 in Python's own numbers, splat by splat."""
    elements = make(300, colored=colored, rest=rest)
    capture = formats.read(save(tmp_path / "a.compressed.ply", elements, text=text, order=order))
    cloud = capture.cloud
    for row in (0, 1, 255, 256, 299):
        position, scale, rotation, opacity, sh = expected(elements, row)
        np.testing.assert_allclose(cloud.positions[row], position, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(cloud.scales[row], scale, rtol=1e-6)
        np.testing.assert_allclose(cloud.rotations[row], rotation, atol=1e-6)
        np.testing.assert_allclose(cloud.opacities[row], opacity, atol=1e-7)
        np.testing.assert_allclose(cloud.sh[row], sh, atol=2e-6)
    assert capture.format == "compressed PLY"


def test_chunks_hold_across_blocks(tmp_path):
    """Oracle: as above, for rows beyond the first blocks of both elements."""
    elements = make(70_000, rest=9)
    cloud = formats.read(save(tmp_path / "a.ply", elements)).cloud
    for row in (16383, 16384, 29127, 65535, 69999):
        position, _, _, _, sh = expected(elements, row)
        np.testing.assert_allclose(cloud.positions[row], position, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(cloud.sh[row], sh, atol=2e-6)


def test_no_splats_are_a_cloud(tmp_path):
    """Oracle: no chunks and no words."""
    assert len(formats.read(save(tmp_path / "a.compressed.ply", make(0))).cloud) == 0


def test_opacity_bytes_reach_both_ends(tmp_path):
    """Oracle: 0 is opacity 0 and 255 is opacity 1, whose logits are infinite."""
    elements = make(2)
    elements["vertex"]["packed_color"] = (0xFFFFFF00, 0x000000FF)
    cloud = formats.read(save(tmp_path / "a.compressed.ply", elements)).cloud
    assert cloud.opacities.tolist() == [0, 1]


def test_a_renamed_file_is_known_by_its_elements(tmp_path):
    """Oracle: the same bytes under three names."""
    written = save(tmp_path / "a.compressed.ply", make(5)).read_bytes()
    for name in ("b.ply", "c", "d.spz"):
        (tmp_path / name).write_bytes(written)
        assert formats.read(tmp_path / name).format == "compressed PLY"


def drop(elements, element, *names):
    kept = [name for name in elements[element].dtype.names if name not in names]
    rows = np.zeros(
        len(elements[element]), [(name, elements[element].dtype[name]) for name in kept]
    )
    for name in kept:
        rows[name] = elements[element][name]
    elements[element] = rows


def spoil(elements, element, name, value):
    elements[element][name][-1] = value


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: e.update(chunk=e["chunk"][:1]), "1 chunks for 300 splats, expected 2"),
        (lambda e: e.update(sh=e["sh"][:299]), "299 rows of element sh, expected 300"),
        (lambda e: e.pop("chunk"), "found no|no element chunk"),
        (lambda e: drop(e, "chunk", "max_scale_y"), "no property max_scale_y in element chunk"),
        (lambda e: drop(e, "chunk", "max_g"), "no property max_g in element chunk"),
        (lambda e: drop(e, "vertex", "packed_scale"), "no uint32 property packed_scale"),
        (lambda e: drop(e, "sh", "f_rest_3"), "8 f_rest_ properties without f_rest_3"),
        (lambda e: spoil(e, "chunk", "min_y", np.nan), "property min_y of chunk 1: found nan"),
        (lambda e: spoil(e, "chunk", "max_b", np.inf), "property max_b of chunk 1: found inf"),
        (lambda e: spoil(e, "chunk", "max_scale_z", 3e5), "scales of splat 2..: found inf"),
    ],
)
def test_elements_that_do_not_fit_are_refused(tmp_path, change, message):
    """Oracle: what was changed."""
    elements = make(300, rest=9)
    change(elements)
    with pytest.raises(FormatError, match=message):
        formats.read(save(tmp_path / "a.compressed.ply", elements))


def test_words_of_another_type_are_refused(tmp_path):
    """Oracle: a float has no bits to unpack."""
    elements = make(3)
    elements["vertex"] = elements["vertex"].astype([(name, "f4") for name in WORDS])
    with pytest.raises(FormatError, match="no uint32 property packed_position in element vertex"):
        formats.read(save(tmp_path / "a.compressed.ply", elements))


def in_rows(cloud: SplatCloud, rows: np.ndarray) -> SplatCloud:
    names = ("positions", "scales", "rotations", "opacities", "sh")
    return SplatCloud(**{name: getattr(cloud, name)[rows] for name in names})


@pytest.mark.parametrize(("count", "degree"), [(1, 0), (255, 1), (256, 2), (257, 3), (9000, 4)])
def test_what_is_written_comes_back_within_the_bounds(tmp_path, count, degree):
    """Oracle: half a step of each code, by plyfile's reading of the chunks: 1/2046 of their extents
    and of their ranges of logarithms, 1/510 of their colours, 1/510 of alpha, 1/64 of harmonics
    within +-3.96, and 4 sqrt(3) of half a step for rotations: 0.27 degrees."""
    from plyfile import PlyData

    cloud = random_cloud(count, degree, seed=2)
    path = tmp_path / "a.compressed.ply"
    formats.write(cloud, path)
    sent = in_rows(cloud, morton.order(cloud.positions))
    again = formats.read(path).cloud
    chunk = PlyData.read(path)["chunk"]
    of_chunk = np.arange(count) // 256
    logs = np.log(again.scales), np.log(sent.scales)
    for prefix, found, wanted in (("", again.positions, sent.positions), ("scale_", *logs)):
        for axis, name in enumerate("xyz"):
            extent = (chunk[f"max_{prefix}{name}"] - chunk[f"min_{prefix}{name}"])[of_chunk]
            bound = extent / (2046 if name == "y" else 4094) * 1.001 + 1e-6
            assert np.all(np.abs(found[:, axis] - wanted[:, axis]) <= bound)
    for channel, name in enumerate("rgb"):
        extent = (chunk[f"max_{name}"] - chunk[f"min_{name}"])[of_chunk]
        error = np.abs(again.sh[:, 0, channel] - sent.sh[:, 0, channel]) * 0.28209479177387814
        assert np.all(error <= extent / 510 * 1.001 + 1e-6)
    apart = differences(again, sent)
    assert apart.opacity <= 1 / 509
    assert apart.rotation <= 0.27
    inside = np.abs(sent.sh[:, 1:]) < 3.96
    errors = np.abs(again.sh[:, 1:] - sent.sh[:, 1:])[inside]
    assert errors.max(initial=0) <= 1 / 64 + 1e-6
    bytes_of_data = (16 + 3 * ((degree + 1) ** 2 - 1)) * count + 72 * len(chunk)
    assert path.stat().st_size < bytes_of_data + 3000


def test_a_chunk_has_the_bounds_of_its_own_splats(tmp_path):
    """Oracle: the least and the greatest of each 256 along the curve, and of the 44 left over."""
    from plyfile import PlyData

    cloud = random_cloud(300, 0)
    formats.write(cloud, tmp_path / "a.compressed.ply")
    chunk = PlyData.read(tmp_path / "a.compressed.ply")["chunk"]
    order = morton.order(cloud.positions)
    for row, part in enumerate((order[:256], order[256:])):
        for axis, name in enumerate("xyz"):
            values = cloud.positions[part, axis]
            assert chunk[f"min_{name}"][row] == values.min()
            assert chunk[f"max_{name}"][row] == values.max()


def test_extremes_have_their_codes(tmp_path):
    """Oracle: opacities 0 and 1 are exact; a scale of 0 is exp(-20); harmonics beyond +-4 are +-4;
    a flat scene keeps its plane exactly, one point its place."""
    cloud = random_cloud(600, 1)
    cloud.positions[:, 2] = 0.1
    cloud.positions[:300] = (5, 6, 0.1)
    cloud.opacities[:2] = (0, 1)
    cloud.scales[0] = (0, 1e30, 1)
    cloud.sh[0, 1:] = 77
    cloud.sh[1, 1:] = -77
    formats.write(cloud, tmp_path / "a.compressed.ply")
    order = morton.order(cloud.positions)
    again = in_rows(formats.read(tmp_path / "a.compressed.ply").cloud, np.argsort(order))
    assert again.opacities[:2].tolist() == [0, 1]
    np.testing.assert_allclose(np.log(again.scales[0, :2]), [-20, 20], rtol=1e-5)
    assert np.all(again.sh[0, 1:] == 4)
    assert np.all(again.sh[1, 1:] == -4)
    assert np.all(again.positions[:, 2] == np.float32(0.1))
    np.testing.assert_allclose(again.positions[:256], [[5, 6, 0.1]] * 256, rtol=1e-6)


@pytest.mark.parametrize("size", [1e-35, 3e38])
def test_the_least_and_the_greatest_scenes_keep_their_shape(tmp_path, size):
    """Oracle: the positions, to 1/1000 of their extent; nothing overflows on the way."""
    cloud = random_cloud(50, 0)
    spread = np.random.default_rng(0).uniform(0, 1, (50, 3))
    cloud = dataclasses.replace(cloud, positions=(spread * size).astype(np.float32))
    formats.write(cloud, tmp_path / "a.compressed.ply")
    order = morton.order(cloud.positions)
    again = formats.read(tmp_path / "a.compressed.ply").cloud.positions.astype(np.float64)
    assert np.abs(again - cloud.positions[order]).max() <= size / 1000


def test_no_splats_are_written_and_read(tmp_path):
    """Oracle: no chunks, no words."""
    formats.write(random_cloud(0, 2), tmp_path / "a.compressed.ply")
    again = formats.read(tmp_path / "a.compressed.ply").cloud
    assert (len(again), again.sh_degree) == (0, 2)


def test_rotations_longer_than_one_are_made_unit(tmp_path):
    """Oracle: three components of sqrt(1/2) leave none for the fourth, and are scaled together."""
    elements = make(1)
    elements["vertex"]["packed_rotation"] = 0x3FFFFFFF
    turn = formats.read(save(tmp_path / "a.compressed.ply", elements)).cloud.rotations[0]
    np.testing.assert_allclose(turn, [0, 3**-0.5, 3**-0.5, 3**-0.5], atol=1e-6)


def test_splats_that_overflow_can_be_left_out(tmp_path):
    """Oracle: of 300, those of the second chunk have codes that mean more than float32 can."""
    elements = make(300)
    elements["chunk"]["max_scale_x"][1] = 3e5
    path = save(tmp_path / "a.compressed.ply", elements)
    capture = formats.read(path, how=ReadOptions(drop_nonfinite=True))
    codes = elements["vertex"]["packed_scale"][256:] >> 21
    low = elements["chunk"]["min_scale_x"][1]
    lost = np.count_nonzero(low + codes / 2047 * (3e5 - low) > 88.73)
    assert lost > 30
    assert len(capture.cloud) == 300 - lost
    assert (
        f"splats dropped because they contain a number that is not finite: {lost}" in capture.notes
    )


def test_antialiasing_is_noted(tmp_path):
    """Oracle: the comment that Brush writes, beside none."""
    for is_meant in (True, False):
        formats.write(
            random_cloud(3, 0),
            tmp_path / "a.compressed.ply",
            how=WriteOptions(antialiased=is_meant),
        )
        assert formats.read(tmp_path / "a.compressed.ply").antialiased == is_meant


def test_harmonics_are_found_by_name(tmp_path):
    """Oracle: the same file with its properties in their own order and nothing between them."""
    elements = make(300, rest=24)
    wanted = formats.read(save(tmp_path / "a.compressed.ply", elements)).cloud.sh
    names = [f"f_rest_{i}" for i in (5, 3, 1, 0, 2, 4, *range(23, 5, -1))]
    rows = np.zeros(300, [("more", "f4"), *((name, "u1") for name in names)])
    for name in names:
        rows[name] = elements["sh"][name]
    elements["sh"] = rows
    found = formats.read(save(tmp_path / "b.compressed.ply", elements)).cloud.sh
    np.testing.assert_array_equal(found, wanted)
