"""Tests of writing SPZ files."""

from __future__ import annotations

import gzip
import struct
from dataclasses import replace

import numpy as np
import pytest

from tests.formats.compare import differences
from tests.formats.samples import random_cloud
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.formats import WriteOptions
from usdsplat.formats.spz import packing
from usdsplat.formats.spz.encoding import finest_bits

HALF_ULP = 2.0**-23
"""Rounding of numbers around 1 to float32, generously."""

LARGEST_TURN = np.degrees(2 * 2 * np.sqrt(3) / (2 * 511 * np.sqrt(2)))
"""[degree] Twice the error of the quaternion: half a step in each of three components, and as much
again times sqrt(3) in the fourth where all are 1/2."""


def within_range(count: int, degree: int, seed: int = 0) -> SplatCloud:
    """A cloud of which nothing needs clamping."""
    cloud = random_cloud(count, degree, seed)
    return replace(cloud, sh=np.clip(0.3 * cloud.sh, -1, 0.96).astype(np.float32))


def header(data: bytes) -> tuple:
    """Magic, version, count, degree, fractional bits, flags, streams of a file."""
    plain = gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data
    return struct.unpack_from("<4sIIBBBB", plain)


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_what_is_written_comes_back_within_the_bounds_of_the_codes(tmp_path, version, degree):
    """Oracle: half a step of each code, as the layout of formats.md 2.4 has it."""
    cloud = within_range(3000, degree)
    formats.write(cloud, tmp_path / "a.spz", how=WriteOptions(spz_version=version))
    capture = formats.read(tmp_path / "a.spz")
    apart = differences(capture.cloud, cloud)
    bits = header((tmp_path / "a.spz").read_bytes())[4]
    assert apart.position <= 2.0 ** -(bits + 1) * (1 + HALF_ULP)
    assert apart.log_scale <= 1 / 32 + 1e-5
    assert apart.opacity <= 1 / 510 + 1e-6
    assert apart.dc <= 0.5 / 255 / 0.15 + 1e-5
    assert apart.rotation <= LARGEST_TURN
    by_degree = np.abs(capture.cloud.sh - cloud.sh).max(axis=(0, 2))
    assert by_degree[1:4].max(initial=0) <= 1 / 32 + 1e-6
    assert by_degree[4:].max(initial=0) <= 1 / 16 + 1e-6
    assert capture.format == f"SPZ {version}"
    assert [path.name for path in tmp_path.iterdir()] == ["a.spz"]


@pytest.mark.parametrize("version", [3, 4])
def test_codes_are_those_of_the_layout(tmp_path, version):
    """Oracle: a splat coded by hand; sizes exp(-4), exp(-3), exp(-2), half a turn about z + w."""
    cloud = SplatCloud(
        positions=np.array([[0.5, -0.25, 1000]], np.float32),
        scales=np.exp(np.array([[-4, -3, -2]], np.float32)),
        rotations=np.array([[-0.1, 0.5, -0.5, 0.7]], np.float32),
        opacities=np.array([0.4], np.float32),
        sh=np.array([[[0, 1, -1], [0.25, -0.25, 0], [0, 0.5, -1], [0, 0, 0]]], np.float32),
    )
    formats.write(cloud, tmp_path / "a.spz", how=WriteOptions(spz_version=version))
    data = (tmp_path / "a.spz").read_bytes()
    steps = [round(value * 2**13) for value in (0.5, -0.25, 1000)]  # 1000 * 2^13 < 2^23
    turn = [(0, 0.5), (1, 0.5), (1, 0.1)]  # x, y, w by sign and magnitude; z is largest
    word = 2
    for negative, magnitude in turn:
        word = word << 10 | negative << 9 | round(magnitude * 511 * 2**0.5)
    planes = [
        b"".join((step & 0xFFFFFF).to_bytes(3, "little") for step in steps),
        bytes([102]),
        bytes([128, 166, 89]),
        bytes([96, 112, 128]),
        word.to_bytes(4, "little"),
        bytes([160, 96, 128, 128, 192, 0, 128, 128, 128]),
    ]
    assert header(data) == (b"NGSP", version, 1, 1, 13, 0, 0 if version == 3 else 6)
    if version == 3:
        assert gzip.decompress(data)[16:] == b"".join(planes)
    else:
        assert _frames(data) == planes


def _frames(data: bytes) -> list[bytes]:
    """Attributes of a file of version 4 without extensions."""
    import zstandard

    streams = data[15]
    assert struct.unpack_from("<I12x", data, 16) == (32,)
    table = [struct.unpack_from("<QQ", data, 32 + 16 * i) for i in range(streams)]
    start = 32 + 16 * streams
    out = []
    for size, unpacked in table:
        out.append(zstandard.ZstdDecompressor().decompress(data[start : start + size]))
        assert len(out[-1]) == unpacked
        start += size
    assert start == len(data)
    return out


@pytest.mark.parametrize(
    ("reach", "bits"),
    [
        (0.0, 24),
        (0.49, 24),
        (0.5, 23),
        (1000.0, 13),
        (2047.9, 12),
        (2048.0, 11),
        (8388607.0, 0),
        (8388608.0, None),
        (np.inf, None),
        (np.nan, None),
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_the_farthest_coordinate_takes_all_bits(reach, bits, sign):
    """Oracle: reach * 2^bits against 2^23 - 1, by hand."""
    positions = np.array([[0, 0, 0], [0, sign * reach, 0]], np.float32)
    assert finest_bits(positions) == bits


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("reach", [0.4999, 1.9999, 4095.9, 8388606.5, 8388607])
def test_no_coordinate_wraps_around(tmp_path, version, reach):
    """Oracle: half a step, at both ends of every range; the library wraps at 2048."""
    cloud = within_range(2, 0)
    cloud.positions[:] = [[reach, -reach, 0], [-reach, reach, 0]]
    formats.write(cloud, tmp_path / "a.spz", how=WriteOptions(spz_version=version))
    read = formats.read(tmp_path / "a.spz").cloud
    np.testing.assert_allclose(read.positions, cloud.positions, rtol=2**-22)


def test_what_no_file_can_hold_is_a_sentence(tmp_path):
    """Oracle: the greatest number of 24 bits and a sign."""
    cloud = within_range(3, 0)
    cloud.positions[1, 2] = 8388608.0
    with pytest.raises(OutputError, match="expected at most 8388607 in SPZ"):
        formats.write(cloud, tmp_path / "a.spz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("version", [3, 4])
def test_what_is_out_of_range_is_clamped(tmp_path, version):
    """Oracle: the values of the first and last codes."""
    cloud = within_range(2, 2)
    cloud.scales[:] = [[0, 1e-30, 1e-5], [400, 1e30, 380]]
    cloud.opacities[:] = [0, 1]
    cloud.sh[:] = 100
    cloud.sh[0] *= -1
    formats.write(cloud, tmp_path / "a.spz", how=WriteOptions(spz_version=version))
    read = formats.read(tmp_path / "a.spz").cloud
    np.testing.assert_allclose(read.scales, np.exp([[-10.0] * 3, [95 / 16] * 3]), rtol=1e-6)
    np.testing.assert_array_equal(read.opacities, [0, 1])
    np.testing.assert_allclose(read.sh[:, 0], np.array([[-1] * 3, [1] * 3]) / 0.3, rtol=1e-6)
    np.testing.assert_array_equal(read.sh[0, 1:], -1)
    np.testing.assert_array_equal(read.sh[1, 1:], np.float32(127 / 128))


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("frame", [None, "rdf", "rub", "rfu", "ldb", "rbu"])
def test_flag_and_frame_are_stated(tmp_path, version, frame):
    """Oracle: bits 0 and 1 of the flags, and the reader's own tests of what the record says."""
    how = WriteOptions(spz_version=version, antialiased=True, frame=frame)
    formats.write(within_range(5, 1), tmp_path / "a.spz", how=how)
    capture = formats.read(tmp_path / "a.spz")
    assert header((tmp_path / "a.spz").read_bytes())[5] == (1 if frame is None else 3)
    assert capture.antialiased
    assert capture.frame == (frame or "rdf")
    assert any("axes" in note for note in capture.notes) == (frame is None)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (WriteOptions(spz_version=2), "found 2, expected 3 or 4"),
        (
            WriteOptions(frame="fur"),
            "frame: found 'fur', expected one that SPZ can name: ldb, rdb, lub",
        ),
    ],
)
def test_what_the_format_has_no_word_for_is_refused(tmp_path, how, message):
    """Oracle: versions and frames of the specification."""
    with pytest.raises(UsageError, match=message):
        formats.write(within_range(1, 0), tmp_path / "a.spz", how=how)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("version", [3, 4])
def test_no_splats_can_be_written(tmp_path, version):
    """Oracle: none come back."""
    formats.write(within_range(0, 3), tmp_path / "a.spz", how=WriteOptions(spz_version=version))
    assert len(formats.read(tmp_path / "a.spz").cloud) == 0


@pytest.mark.parametrize("size", [1, 1000, 1 << 20])
def test_pieces_deflated_in_threads_are_one_member(tmp_path, monkeypatch, size):
    """Oracle: Python's gzip, which checks length and checksum, with pieces of any size."""
    cloud = within_range(300, 3)
    formats.write(cloud, tmp_path / "whole.spz", how=WriteOptions(spz_version=3))
    monkeypatch.setattr(packing, "_PIECE", size)
    formats.write(cloud, tmp_path / "cut.spz", how=WriteOptions(spz_version=3, frame="rdf"))
    whole, cut = (
        gzip.decompress((tmp_path / name).read_bytes()) for name in ("whole.spz", "cut.spz")
    )
    record = struct.pack("<III", 0xADBE0003, 4, 6)
    assert cut == whole[:14] + b"\x02" + whole[15:] + record


@pytest.mark.parametrize("version", [3, 4])
def test_progress_reaches_its_end(tmp_path, version):
    """Oracle: the last step says that all is done."""
    steps = []

    class Told:
        def step(self, what, done, total):
            steps.append((what, done, total))

    formats.write(
        within_range(100, 1),
        tmp_path / "a.spz",
        how=WriteOptions(spz_version=version),
        progress=Told(),
    )
    assert steps[-1][0] == f"writing {tmp_path / 'a.spz'}"
    assert steps[-1][1] == steps[-1][2] == len(steps)


def test_other_readers_files_and_ours_hold_the_same_codes(data, tmp_path):
    """Oracle: `out_v4.spz`, which splat-transform wrote of the same cloud with 12 bits."""
    cloud = formats.read(data / "oracle" / "tiny.ply").cloud
    formats.write(cloud, tmp_path / "a.spz")
    ours = _frames((tmp_path / "a.spz").read_bytes())
    theirs = _frames((data / "oracle" / "out_v4.spz").read_bytes())
    for mine, other in zip(ours[1:5], theirs[1:5], strict=True):
        a, b = np.frombuffer(mine, np.uint8), np.frombuffer(other, np.uint8)
        # Other roundings of halves and of the logarithm may give the code next to it.
        assert np.count_nonzero(a != b) < 0.001 * len(a)
