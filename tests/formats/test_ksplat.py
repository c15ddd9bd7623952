"""Tests of mkkellogg's .ksplat: files made from chosen codes, and files of its own writer."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from tests.formats.compare import differences
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.formats import options

C0 = 0.28209479177387814
TYPES = ("fff", "Hee", "HeB")


def header(level, *, count, sections=1, room=None, harmonics=(0.0, 0.0), version=(0, 1)):
    """4096 bytes."""
    room = sections if room is None else room
    data = struct.pack("<BBxx4IHxx3f2f", *version, room, sections, count, count, level, 0, 0, 0,
                       *harmonics)  # fmt: skip
    return data.ljust(4096, b"\0")


def section(level, splats, *, degree=0, centres=(), full=0, bucket=2, lengths=(), **changes):
    """Header of 1024 bytes, and the data, of rows (place, scale, rotation, rgba, harmonics)."""
    said = {"count": len(splats), "room": len(splats), "bucket": bucket, "buckets": len(centres),
            "block": 4.0, "bucket_bytes": 12 * bool(level), "top": 1000, "full": full,
            "partial": len(lengths), "degree": degree} | changes  # fmt: skip
    order = ("count", "room", "bucket", "buckets", "block", "bucket_bytes", "top", "full")
    head = struct.pack("<4IfHxxIxxxxIIH", *(said[key] for key in (*order, "partial", "degree")))
    place, shape, harmonics = TYPES[level]
    rests = 3 * ((degree + 1) ** 2 - 1)
    layout = f"<3{place}3{shape}4{shape}4B{rests}{harmonics}"
    data = struct.pack(f"<{len(lengths)}I", *lengths)
    data += b"".join(struct.pack("<3f", *centre) for centre in centres)
    data += b"".join(struct.pack(layout, *sum(map(tuple, row), ())) for row in splats)
    return head.ljust(1024, b"\0"), data


def save(path, level, *sections, **said):
    """A file of sections whose count is true unless `said` lies."""
    counts = [struct.unpack_from("<I", head)[0] for head, _ in sections]
    first = header(level, **{"count": sum(counts), "sections": len(sections)} | said)
    path.write_bytes(first + b"".join(h for h, _ in sections) + b"".join(d for _, d in sections))
    return path


def splat(place, degree=0, first=0, scale=(0.5, 1, 2)):
    """A row with harmonics first, first + 1, ... in the order of the file."""
    rest = range(first, first + 3 * ((degree + 1) ** 2 - 1))
    return place, scale, (0, 0, 0.5, 0), (255, 0, 51, 204), rest


@pytest.mark.parametrize("level", [0, 1, 2])
def test_sections_and_buckets_decode_as_the_layout_says(tmp_path, level):
    """Oracle: formats.md 2.6. A code c is (c - 1000) * 4 / 2 / 1000 from its bucket's centre, which
    are two full buckets of two splats, one of none, of one and of two; harmonics count by band,
    then channel, then order; at level 2 a byte b is b / 255 * 2.55 - 0.5."""
    places = [(1000 + i, 1000 - i, 2000) for i in range(7)]
    splats = [splat(place, 2, first=i) for i, place in enumerate(places)]
    centres = [(10 * i, 0, -i) for i in range(5)] if level else []
    buckets = {"full": 2, "lengths": (0, 1, 2)} if level else {}
    one = section(level, splats, degree=2, centres=centres, **buckets)
    other = section(level, [splat((5, 6, 7))], centres=[(1, 1, 1)] * bool(level),
                    lengths=(1,) * bool(level))  # fmt: skip
    capture = formats.read(save(tmp_path / "a.ksplat", level, one, other, harmonics=(-0.5, 2.05)))
    cloud = capture.cloud
    buckets_of = (0, 0, 1, 1, 3, 4, 4)
    for i, (x, y, z) in enumerate(places):
        b = buckets_of[i]
        near = ((x - 1000) / 500 + 10 * b, (y - 1000) / 500, (z - 1000) / 500 - b)
        np.testing.assert_allclose(cloud.positions[i], near if level else (x, y, z), rtol=1e-6)
        for channel in range(3):
            band1 = [channel * 3 + k for k in range(3)]
            band2 = [9 + channel * 5 + k for k in range(5)]
            codes = np.array(band1 + band2) + i
            wanted = codes / 255 * 2.55 - 0.5 if level == 2 else codes
            np.testing.assert_allclose(cloud.sh[i, 1:, channel], wanted, rtol=1e-5, atol=1e-6)
    last = np.array([5, 6, 7])
    np.testing.assert_allclose(cloud.positions[7], (last - 1000) / 500 + 1 if level else last)
    assert not cloud.sh[7, 1:].any()
    np.testing.assert_array_equal(cloud.scales, [[0.5, 1, 2]] * 8)
    np.testing.assert_array_equal(cloud.rotations, [[0, 0, 1, 0]] * 8)
    np.testing.assert_allclose(cloud.opacities, 0.8)
    colors = [(np.array([1, 0, 0.2]) - 0.5) / C0] * 8
    np.testing.assert_allclose(cloud.sh[:, 0], colors, rtol=1e-6)
    assert (capture.format, capture.frame) == (f"KSPLAT 0.1, level {level}", "rdf")


def test_buckets_hold_across_blocks(tmp_path):
    """Oracle: splat i of 40,000 lies in bucket i // 7, whose centre is that number."""
    count = 40_000
    rows = [splat((1000, 1000, 1000))] * count
    full, rest = divmod(count, 7)
    made = section(1, rows, centres=[(b, 0, 0) for b in range(full + 1)], full=full, bucket=7,
                   lengths=(rest,))  # fmt: skip
    cloud = formats.read(save(tmp_path / "a.ksplat", 1, made)).cloud
    np.testing.assert_array_equal(cloud.positions[:, 0], np.arange(count) // 7)


def test_what_the_header_leaves_out_has_its_default(tmp_path):
    """Oracle: formats.md 2.6: harmonics over -1.5 to 1.5, a scale range of 32767."""
    made = section(2, [splat((65534, 0, 32767), 1)], degree=1, centres=[(0, 0, 0)], lengths=(1,),
                   top=0)  # fmt: skip
    cloud = formats.read(save(tmp_path / "a.ksplat", 2, made)).cloud
    np.testing.assert_allclose(cloud.positions, [[2, -2, 0]])
    np.testing.assert_allclose(cloud.sh[0, 1:, 0], np.arange(3) / 255 * 3 - 1.5, rtol=1e-6)


def test_degree_3_follows_the_bands_below(tmp_path):
    """Oracle: 24 numbers stand before those of degree 3, 7 for each channel."""
    cloud = formats.read(
        save(tmp_path / "a.ksplat", 0, section(0, [splat((0, 0, 0), 3)], degree=3))
    ).cloud
    for channel in range(3):
        wanted = np.arange(7) + 24 + 7 * channel
        np.testing.assert_array_equal(cloud.sh[0, 9:, channel], wanted)


def test_a_renamed_file_is_known_by_its_header(tmp_path):
    """Oracle: the same bytes under two names; without splats it is a cloud of none."""
    for name in ("a.ksplat", "a.ply"):
        assert len(formats.read(save(tmp_path / name, 0, section(0, []))).cloud) == 0
    (tmp_path / "b.ksplat").write_bytes(b"no capture")
    with pytest.raises(FormatError, match="found 10 bytes, expected a header of 4096"):
        formats.read(tmp_path / "b.ksplat")


ONE = [splat((0, 0, 0))]
BUCKET = {"centres": [(0, 0, 0)], "lengths": (1,)}


@pytest.mark.parametrize(
    ("level", "rows", "changes", "said", "message"),
    [
        (0, ONE, {}, {"version": (1, 0)}, "version 1.0, expected version 0.1"),
        (0, ONE, {}, {"version": (0, 0)}, "version 0.0"),
        (3, ONE, {}, {}, "compression level 3, expected 0, 1 or 2"),
        (0, ONE, {}, {"sections": 2, "room": 1}, "2 sections and room for 1"),
        (0, ONE, {}, {"room": 2**32 - 1}, "1 sections and room for 4294967295 in 5164 bytes"),
        (0, ONE, {}, {"count": 2**32 - 1}, "1 splats in its sections, expected 4294967295"),
        (0, ONE, {"degree": 4}, {}, "section 0: found harmonics of degree 4"),
        (0, ONE, {"room": 0}, {}, "section 0: found 1 splats, expected at most 0"),
        (0, ONE, {"count": 2**32 - 1, "room": 2**32 - 1}, {}, "data up to byte 188978566100"),
        (0, ONE, {"degree": 1}, {}, "data up to byte 5200, expected an end within 5164"),
        (1, ONE, BUCKET | {"partial": 2**32 - 1}, {}, "section 0: found data up to byte"),
        (1, ONE, BUCKET | {"buckets": 2**32 - 1}, {}, "section 0: found data up to byte"),
        (1, ONE, BUCKET | {"buckets": 0}, {}, "0 full and 1 partial buckets"),
        (1, ONE, BUCKET | {"bucket_bytes": 11}, {}, "buckets of 11 bytes, expected 1 of 12"),
        (1, ONE, {}, {}, "0 splats in its buckets, expected 1"),
        (1, ONE, BUCKET | {"lengths": (2**32 - 1,)}, {}, "4294967295 splats in its buckets"),
        (1, ONE, {"centres": [(0, 0, 0)], "full": 1, "bucket": 2**32 - 1}, {}, "4294967295 splats"),
        (1, ONE, BUCKET | {"block": np.nan}, {}, "positions of splat 0: found nan"),
        (2, [splat((0, 0, 0), 1)], BUCKET | {"degree": 1}, {"harmonics": (np.nan, 1)}, "sh of spl"),
        (0, [splat((0, 0, 0), scale=(1, 1, -1))], {}, {}, "scales of splat 0: found -1.0"),
        (0, [splat((0, np.inf, 0))], {}, {}, "positions of splat 0: found inf"),
    ],
)  # fmt: skip
def test_numbers_that_do_not_fit_are_refused(tmp_path, level, rows, changes, said, message):
    """Oracle: what was changed."""
    rows = section(min(level, 2), rows, **changes) if level != 0 else lenient(rows, changes)
    with pytest.raises(FormatError, match=message):
        formats.read(save(tmp_path / "a.ksplat", level, rows, **{"count": 1} | said))


def lenient(rows, changes):
    """A section of level 0 whose data is of degree 0 whatever its header claims."""
    head, _ = section(0, [], **{"count": 1, "room": 1} | changes)
    return head, section(0, rows)[1]


LEVELS = {
    0: (0, 2e-7, 1e-4, 0),
    1: (3.9e-5, 2**-10, 0.12, 2**-10),
    2: (3.9e-5, 2**-10, 0.12, 8e-3),
}
"""Level -> greatest errors of position, logarithm of scale, rotation [degree] and harmonics against
what was encoded; formats.md measured the harmonics, whose range leaves one coefficient out."""


@pytest.mark.parametrize("level", LEVELS)
def test_files_of_its_own_writer_decode_as_elsewhere(data, level):
    """Oracle: splat-transform's decoding of what GaussianSplats3D wrote, and the cloud that was
    encoded: one of its 1000 splats is too faint and was dropped."""
    ours = formats.read(data / "oracle" / f"k{level}.ksplat").cloud
    theirs = formats.read(data / "oracle" / f"rt_k{level}.ply").cloud
    apart = differences(ours, theirs)
    assert max(apart.position, apart.log_scale, apart.opacity, apart.dc, apart.harmonics) < 2e-6
    assert apart.rotation < 1e-3
    source = formats.read(data / "oracle" / "tiny.ply").cloud
    gaps = np.linalg.norm(ours.positions[:, None] - source.positions[None], axis=2)
    row = np.argmin(gaps, axis=1)
    assert len(set(row)) == len(ours) == 999
    fields = ("positions", "scales", "rotations", "opacities")
    sent = SplatCloud(
        **{name: getattr(source, name)[row] for name in fields}, sh=source.sh[row, :9]
    )
    apart = differences(ours, sent)
    found = (apart.position, apart.log_scale, apart.rotation, apart.harmonics)
    assert np.all(np.array(found) <= LEVELS[level]), found
    assert max(apart.opacity, apart.dc * C0) <= 1 / 254


def test_damaged_splats_can_be_left_out(tmp_path):
    """Oracle: one of three is sound."""
    rows = [splat((0, np.nan, 0)), splat((1, 2, 3)), splat((0, 0, 0), scale=(-1, 1, 1))]
    path = save(tmp_path / "a.ksplat", 0, section(0, rows))
    capture = formats.read(path, how=options.ReadOptions(drop_nonfinite=True))
    np.testing.assert_array_equal(capture.cloud.positions, [[1, 2, 3]])
    assert "splats dropped because they contain a number that is not finite: 2" in capture.notes


@pytest.mark.filterwarnings("error")
def test_a_signalling_nan_is_dropped_in_silence(tmp_path):
    """Oracle: one of two splats is sound; NumPy warns when it meets such a number unprepared."""
    path = save(tmp_path / "a.ksplat", 0, section(0, [splat((0, 0, 0)), splat((1, 2, 3))]))
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 4096 + 1024 + 24, 0x7FA00000)
    path.write_bytes(data)
    capture = formats.read(path, how=options.ReadOptions(drop_nonfinite=True))
    np.testing.assert_array_equal(capture.cloud.positions, [[1, 2, 3]])
