"""Tests of SPZ: files packed byte by byte, decoded one number at a time."""

from __future__ import annotations

import gzip
import io
import math
import struct

import numpy as np
import pytest

from tests.formats.samples import spz, spz_header
from usdsplat import formats
from usdsplat.core.errors import FormatError
from usdsplat.formats import cloud_builder
from usdsplat.formats import spz as spz_module
from usdsplat.formats.spz.extensions import COORDINATE_SYSTEM, EXTENSION_LIMIT

COUNT = 20


def planes(version: int, degree: int, *, count: int = COUNT, seed: int = 1) -> dict[str, bytes]:
    """Random bytes of every attribute; half-precision positions stay finite."""
    rng = np.random.default_rng(seed)
    sizes = {
        "positions": 9,
        "alphas": 1,
        "colors": 3,
        "scales": 3,
        "rotations": 4 if version > 2 else 3,
        "sh": 3 * ((degree + 1) ** 2 - 1),
    }
    data = {name: rng.bytes(count * size) for name, size in sizes.items()}
    if version == 1:
        data["positions"] = rng.normal(size=count * 3).astype("<f2").tobytes()
    return data


def packed_v4(
    data: dict[str, bytes], degree: int, *, extensions: bytes = b"", **header: int
) -> bytes:
    """A file of version 4."""
    import zstandard

    streams = [plane for plane in data.values() if plane]
    frames = [zstandard.ZstdCompressor().compress(plane) for plane in streams]
    head = spz_header(COUNT, version=4, degree=degree, **header)[:15] + bytes([len(streams)])
    table = b"".join(
        struct.pack("<QQ", len(f), len(s)) for f, s in zip(frames, streams, strict=True)
    )
    start = struct.pack("<I12x", 32 + len(extensions))
    return head + start + extensions + table + b"".join(frames)


def packed(version: int, degree: int, data: dict[str, bytes], **header: int) -> bytes:
    if version == 4:
        return packed_v4(data, degree, **header)
    return spz(b"".join(data.values()), count=COUNT, version=version, degree=degree, **header)


def expected(version, degree, bits, data, row):
    """Position, scale, rotation, opacity and harmonics of a splat, by formats.md section 2.4."""
    if version == 1:
        position = struct.unpack_from("<3e", data["positions"], row * 6)
    else:
        at = [row * 9 + 3 * axis for axis in range(3)]
        steps = [int.from_bytes(data["positions"][i : i + 3], "little", signed=True) for i in at]
        position = [step / 2**bits for step in steps]
    scale = [math.exp(code / 16 - 10) for code in data["scales"][row * 3 : row * 3 + 3]]
    if version < 3:
        x, y, z = (code / 127.5 - 1 for code in data["rotations"][row * 3 : row * 3 + 3])
        quaternion = [math.sqrt(max(0, 1 - x * x - y * y - z * z)), x, y, z]
    else:
        word = int.from_bytes(data["rotations"][row * 4 : row * 4 + 4], "little")
        largest = word >> 30
        xyzw = [0.0] * 4
        for index in reversed([i for i in range(4) if i != largest]):  # the last is lowest
            magnitude = (word & 511) / 511 / math.sqrt(2)
            xyzw[index] = -magnitude if word & 512 else magnitude
            word >>= 10
        xyzw[largest] = math.sqrt(max(0, 1 - sum(v * v for v in xyzw)))
        quaternion = [xyzw[3], *xyzw[:3]]
    length = math.sqrt(sum(v * v for v in quaternion))
    dc = [((code / 255) - 0.5) / 0.15 for code in data["colors"][row * 3 : row * 3 + 3]]
    per_channel = (degree + 1) ** 2 - 1
    rest = [
        [(data["sh"][(row * per_channel + k) * 3 + c] - 128) / 128 for c in range(3)]
        for k in range(per_channel)
    ]
    return position, scale, [v / length for v in quaternion], data["alphas"][row] / 255, [dc, *rest]


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
@pytest.mark.parametrize(("version", "bits"), [(1, 12), (2, 12), (2, 0), (3, 24), (4, 8)])
def test_bytes_decode_as_the_layout_says(tmp_path, version, bits, degree):
    """Oracle: the layout of formats.md 2.4 in Python's own numbers, splat by splat."""
    data = planes(version, degree)
    (tmp_path / "a.spz").write_bytes(packed(version, degree, data, fractional_bits=bits))
    capture = formats.read(tmp_path / "a.spz")
    for row in range(COUNT):
        position, scale, rotation, opacity, sh = expected(version, degree, bits, data, row)
        np.testing.assert_allclose(capture.cloud.positions[row], position, rtol=1e-6)
        np.testing.assert_allclose(capture.cloud.scales[row], scale, rtol=1e-6)
        np.testing.assert_allclose(capture.cloud.rotations[row], rotation, atol=1e-6)
        np.testing.assert_allclose(capture.cloud.opacities[row], opacity, atol=1e-7)
        np.testing.assert_allclose(capture.cloud.sh[row], sh, atol=1e-6)
    assert capture.format == f"SPZ {version}"
    assert capture.frame == "rdf"
    assert any("axes" in note for note in capture.notes)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_blocks_are_decoded_in_their_places(tmp_path, monkeypatch, version):
    """Oracle: the same bytes decoded in one block."""
    (tmp_path / "a.spz").write_bytes(packed(version, 2, planes(version, 2)))
    whole = formats.read(tmp_path / "a.spz").cloud
    monkeypatch.setattr(spz_module, "BLOCK", 3)
    monkeypatch.setattr(cloud_builder, "BLOCK", 3)
    parts = formats.read(tmp_path / "a.spz").cloud
    for name in ("positions", "scales", "rotations", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_data_inside_another_file_is_read(tmp_path):
    """Oracle: the same bytes in a file of their own."""
    data = packed(4, 1, planes(4, 1))
    (tmp_path / "a.spz").write_bytes(data)
    own = formats.read(tmp_path / "a.spz")
    inside = spz_module.unpack("b.glb: buffer view 3", io.BytesIO(data), len(data))
    np.testing.assert_array_equal(inside.cloud.sh, own.cloud.sh)
    assert (inside.files, own.files) == ((), (tmp_path / "a.spz",))
    with pytest.raises(FormatError, match=r"^b\.glb: buffer view 3: "):
        spz_module.unpack("b.glb: buffer view 3", io.BytesIO(data[:50]), 50)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_no_splats_are_a_cloud(tmp_path, version):
    """Oracle: a header that counts none."""
    import zstandard

    if version == 4:
        frame = zstandard.ZstdCompressor().compress(b"")
        table = struct.pack("<QQ", len(frame), 0) * 5
        whole = spz_header(0, version=4)[:15] + b"\x05" + struct.pack("<I12x", 32)
        (tmp_path / "a.spz").write_bytes(whole + table + frame * 5)
    else:
        (tmp_path / "a.spz").write_bytes(spz(b"", version=version, count=0))
    assert len(formats.read(tmp_path / "a.spz").cloud) == 0


@pytest.mark.parametrize("version", [2, 4])
@pytest.mark.parametrize(("flags", "expected_flag"), [(0, False), (1, True)])
def test_the_projection_flag_is_kept(tmp_path, version, flags, expected_flag):
    """Oracle: bit 0 of the flags."""
    (tmp_path / "a.spz").write_bytes(packed(version, 0, planes(version, 0), flags=flags))
    assert formats.read(tmp_path / "a.spz").antialiased is expected_flag


def record(kind: int, payload: bytes) -> bytes:
    return struct.pack("<II", kind, len(payload)) + payload


def with_extensions(version: int, block: bytes, flags: int = 2) -> bytes:
    data = planes(version, 1)
    if version == 4:
        return packed_v4(data, 1, extensions=block, flags=flags)
    payload = b"".join(data.values()) + block
    return spz(payload, count=COUNT, version=version, degree=1, flags=flags)


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize(
    ("index", "frame"),
    [(0, "rub"), (1, "ldb"), (4, "rub"), (6, "rdf"), (7, "luf"), (12, "rfu"), (16, "rbu")],
)
def test_a_stated_frame_is_honoured(tmp_path, version, index, frame):
    """Oracle: the enumeration of nianticlabs/spz, where unspecified means its own frame."""
    block = record(7, b"abc") + record(COORDINATE_SYSTEM, struct.pack("<I", index))
    (tmp_path / "a.spz").write_bytes(with_extensions(version, block))
    capture = formats.read(tmp_path / "a.spz")
    assert capture.frame == frame
    assert capture.notes == ("ignored extension 0x00000007, unknown, of 3 bytes",)


@pytest.mark.parametrize("version", [3, 4])
def test_each_extension_is_named(tmp_path, version):
    """Oracle: nianticlabs/spz, `extensions/README.md`; a record of another length is not it."""
    block = record(0xADBE0002, struct.pack("<3f", -0.5, 0.25, 2)) + record(0xADBE0001, b"")
    (tmp_path / "a.spz").write_bytes(with_extensions(version, block))
    assert formats.read(tmp_path / "a.spz").notes[1:] == (
        "ignored extension 0xadbe0002, "
        "safe orbit camera: elevation -0.5 to 0.25 radians, radius from 2",
        "ignored extension 0xadbe0001, unknown, of 0 bytes",
    )
    (tmp_path / "a.spz").write_bytes(with_extensions(version, record(0xADBE0002, bytes(11))))
    assert formats.read(tmp_path / "a.spz").notes[1:] == (
        "ignored extension 0xadbe0002, unknown, of 11 bytes",
    )


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize(
    ("block", "message"),
    [
        (b"\x01\x02\x03", "3 stray bytes"),
        (struct.pack("<II", 7, 100) + bytes(99), "extension 0x00000007 of 100 bytes where 99"),
        (record(COORDINATE_SYSTEM, struct.pack("<I", 17)), "coordinate system 17"),
        (record(COORDINATE_SYSTEM, b"\x06"), "coordinate system 6 in 1 bytes"),
    ],
)
def test_extensions_that_cannot_be_are_refused(tmp_path, version, block, message):
    """Oracle: the record format."""
    (tmp_path / "a.spz").write_bytes(with_extensions(version, block))
    with pytest.raises(FormatError, match=message):
        formats.read(tmp_path / "a.spz")


GOOD = planes(2, 0)
NOT_FINITE = np.array([1, np.nan, 1], "<f2").tobytes() + bytes(10)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (gzip.compress(b"NOPE" + bytes(12), mtime=0), "magic b'NOPE'"),
        (gzip.compress(b"NGSP", mtime=0), "4 bytes of the header, expected 16"),
        (spz(b"", count=1, version=0), "SPZ version 0"),
        (spz(b"", count=1, version=5), "SPZ version 5"),
        (spz(b"", count=1, version=4), "SPZ version 4 in gzip"),
        (spz(b"", count=1, degree=5), "harmonics of degree 5"),
        (spz(b"", count=1, fractional_bits=25), "25 fractional bits"),
        (spz(b"", count=1, fractional_bits=255), "255 fractional bits"),
        (spz(b"", count=2**32 - 1), "4294967295 splats in .* bytes"),
        (spz(b"".join(GOOD.values())[:-1], count=COUNT), "59 bytes of rotations, expected 60"),
        (spz(b"".join(GOOD.values()), count=COUNT + 1), "bytes of rotations"),
        (spz(b"".join(GOOD.values()) + b"x", count=COUNT), "more data after the last splat"),
        (spz(bytes(16), count=1)[:-9], "truncated gzip data"),
        (spz(bytes(16), count=1)[:-8] + bytes(8), "damaged gzip data"),
        (b"\x1f\x8b", "truncated gzip data"),
        (spz(NOT_FINITE, count=1, version=1), "positions of splat 0: found nan"),
        (with_extensions(2, record(9, bytes(EXTENSION_LIMIT))), "more data after the last splat"),
        (b"", "b'' at the start"),
        (b"just text", "b'just' at the start, expected b'NGSP' or gzip"),
    ],
)  # fmt: skip
def test_a_gzip_file_that_lies_is_refused(tmp_path, content, message):
    """Oracle: what is wrong with it."""
    (tmp_path / "a.spz").write_bytes(content)
    with pytest.raises(FormatError, match=message):
        formats.read(tmp_path / "a.spz")


def patched(at: int, value: bytes) -> bytes:
    good = packed_v4(planes(4, 1), 1)
    return good[:at] + value + good[at + len(value) :]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (patched(4, b"\x02"), "SPZ version 2 without gzip"),
        (patched(8, b"\x15"), "180 bytes of positions, expected 189"),
        (patched(15, b"\x05"), "5 streams for degree 1, expected 6"),
        (patched(16, b"\x1f"), "table of contents at byte 31"),
        (patched(16, b"\xff\xff\xff\x7f"), "table of contents at byte 2147483647"),
        (patched(16, b"\x00\x20"), "bytes left for extensions"),
        (patched(32, b"\xff\xff"), "bytes left for positions"),
        (patched(40, b"\xb5"), "181 bytes of positions, expected 180"),
        (patched(32 + 6 * 16, b"spoilt"), "damaged zstd data"),
        (packed_v4(planes(4, 1), 1) + b"x", "1 bytes after the last stream"),
        (packed_v4(planes(4, 1), 1)[:-1], "bytes left for harmonics"),
        (packed_v4(planes(4, 1), 1)[:40], "bytes left for table of contents"),
        (packed_v4(planes(4, 1), 1)[:20], "a header of 20 bytes"),
    ],
)
def test_a_zstd_file_that_lies_is_refused(tmp_path, content, message):
    """Oracle: what is wrong with it."""
    (tmp_path / "a.spz").write_bytes(content)
    with pytest.raises(FormatError, match=message):
        formats.read(tmp_path / "a.spz")


def test_rotations_without_w_err_by_degrees_near_half_turns(tmp_path):
    """Oracle: rounding each of x, y, z to 1/127.5, as the library's encoder does, at w = 0."""
    rng = np.random.default_rng(4)
    axes = rng.normal(size=(2000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    codes = np.rint((axes + 1) * 127.5).astype(np.uint8)
    payload = bytes(2000 * 16) + codes.tobytes()
    (tmp_path / "a.spz").write_bytes(spz(payload, count=2000, version=2))
    turns = formats.read(tmp_path / "a.spz").cloud.rotations.astype(np.float64)
    cosines = np.abs(np.einsum("ni,ni->n", turns[:, 1:], axes))
    worst = np.degrees(2 * np.arccos(np.minimum(cosines, 1))).max()
    assert 5 < worst < 14
