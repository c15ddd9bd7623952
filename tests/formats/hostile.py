"""Files that mean harm: bombs built on the spot, and good files with seeded faults.

Other tests use both: `bombs` must be refused, `mutations` refused or read as finite clouds, in a
sentence, a moment and little memory.
"""

from __future__ import annotations

import gzip
import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tests.formats.samples import (
    SPLAT_NAMES,
    SPLAT_ROW,
    declared_webp,
    ply,
    sog_files,
    spz,
    spz_header,
    with_meta,
    zipped,
)

GIGABYTE = 1 << 30
_ZEROS = bytes(1 << 24)

Fault = Callable[[np.random.Generator, bytes], bytes]


def bombs(folder: Path) -> list[Path]:
    """Write every bomb into `folder`, about 50 MB in all, and return their paths.

    Each ends in the suffix of the format that it pretends to be.
    """
    made = {
        "zeros_behind_a_header.spz": zeros_in_gzip(spz_header(1000, degree=3)),
        "zeros_that_fit_the_header.spz": zeros_in_gzip(spz_header(2 * GIGABYTE // 64, degree=3)),
        "zeros_as_extensions.spz": zeros_in_gzip(spz_header(0, flags=2)),
        "fractional_bits_255.spz": spz(bytes(19), count=1, fractional_bits=255),
        "count_of_no_data.spz": spz(b"", count=1_000_000, degree=3),
        "zstd_zeros.spz": _zstd_bomb(),
        "endless_header.ply": b"ply\nformat ascii 1.0\n" + b"comment once more\n" * 1_200_000,
        "endless_line.ply": b"ply\nformat ascii 1.0\ncomment " + b"x" * 20_000_000,
        "endless_row.ply": _header("ascii", 1) + b"1" * 20_000_000,
        "many_properties.ply": _header("ascii", 10**17, ("x", "y", "z", *map(str, range(3000)))),
        "huge_count.ply": _header("binary_little_endian", 10**18 - 1),
        "no_columns.ply": _header("binary_little_endian", 10**18 - 1, ()),
        "chunks_of_nothing.compressed.ply": _compressed_header(10**15),
        "largest_image.sog": {**sog_files(), "sh0.webp": declared_webp(16384, 16384)},
        "largest_palette.sog": {**sog_files(), "shN_centroids.webp": declared_webp(16384, 16384)},
        "climbing.sog": {**_renamed("../../sh0.webp"), "../../sh0.webp": b"RIFF"},
        "absolute.sog": {**_renamed("/etc/passwd"), "/etc/passwd": b"RIFF"},
        "short_codebook.sog": _with_codebook([0.0] * 100),
        "codebook_of_text.sog": _with_codebook(["0"] * 256),
        "deep_meta.sog": {"meta.json": b'{"a":' * 100_000},
        "long_meta.sog": {"meta.json": b" " * (1 << 26)},
        "long_number.sog": {**sog_files(), "meta.json": b'{"count": ' + b"9" * 500_000 + b"}"},
        "zeros_for_an_image.sog": {**sog_files(), "sh0.webp": bytes(1 << 28)},
    }
    paths = []
    for name, content in made.items():
        path = folder / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            zipped(path, content, method=zipfile.ZIP_DEFLATED)
        paths.append(path)
    return paths


def zeros_in_gzip(start: bytes, size: int = 2 * GIGABYTE) -> bytes:
    """A gzip file of `start` and `size` zeros, a thousandth as long."""
    pack = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    first = pack.compress(start) + pack.flush(zlib.Z_FULL_FLUSH)
    middle = pack.compress(_ZEROS) + pack.flush(zlib.Z_FULL_FLUSH)  # may be repeated as it is
    times = size // len(_ZEROS)
    check = zlib.crc32(start)
    for _ in range(times):
        check = zlib.crc32(_ZEROS, check)
    tail = struct.pack("<II", check, (len(start) + times * len(_ZEROS)) & 0xFFFFFFFF)
    return b"\x1f\x8b\x08" + bytes(6) + b"\xff" + first + middle * times + pack.flush() + tail


def mutations(data_folder: Path, out_folder: Path, count: int, seed: int) -> Iterator[Path]:
    """Yield `count` damaged copies of small good files, the same for the same seed.

    Args:
        data_folder: The shared test data.
        out_folder: Where to write; a copy is left there, under its number and a telling name.
        count: Files to make; formats take turns.
        seed: Of all choices.
    """
    rng = np.random.default_rng(seed)
    sources = list(_sources(data_folder))
    for number in range(count):
        name, content = sources[number % len(sources)]
        fault = _FAULTS[int(rng.integers(len(_FAULTS)))]
        path = out_folder / f"{number:03}_{fault.__name__.strip('_')}_{name}"
        if isinstance(content, bytes):
            path.write_bytes(_inside(rng, content, fault))
        else:
            path.mkdir()
            victim = sorted(content)[int(rng.integers(len(content)))]
            for file, data in content.items():
                (path / file).write_bytes(fault(rng, data) if file == victim else data)
        yield path


def _sources(data: Path) -> Iterator[tuple[str, bytes | dict[str, bytes]]]:
    """Small good files of every format; folders as name -> content."""
    for file in ("tiny_sh0.ply", "out.compressed.ply", "out.sog", "out_v3.spz", "out_v4.spz"):
        yield file, (data / "oracle" / file).read_bytes()
    rows = np.array([SPLAT_ROW] * 20)
    yield "text.ply", _header("ascii", 20) + "\n".join(_words(row) for row in rows).encode()
    yield "points.ply", ply(rows[:, :3], names=("x", "y", "z"))
    body = np.random.default_rng(0).bytes(30 * 28)
    yield "old.spz", spz(body, count=30, version=2, degree=1)
    yield "folder", sog_files()


def _inside(rng: np.random.Generator, data: bytes, fault: Fault) -> bytes:
    """Apply `fault` to the file, or half the time to what a container holds."""
    if data[:2] == b"\x1f\x8b" and rng.random() < 0.5:
        return gzip.compress(fault(rng, gzip.decompress(data)), 1)
    if data[:2] == b"PK" and rng.random() < 0.6:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        victim = "meta.json" if rng.random() < 0.5 else str(rng.choice(sorted(files)))
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, fault(rng, content) if name == victim else content)
        return out.getvalue()
    return fault(rng, data)


def _flip_bits(rng: np.random.Generator, data: bytes) -> bytes:
    return _flipped(rng, data, len(data))


def _flip_header_bits(rng: np.random.Generator, data: bytes) -> bytes:
    return _flipped(rng, data, 64)


def _cut(rng: np.random.Generator, data: bytes) -> bytes:
    return data[: int(rng.integers(len(data)))]


def _change_number(rng: np.random.Generator, data: bytes) -> bytes:
    """Replace one of the decimal numbers near the start."""
    numbers = [run for run in _digit_runs(data[:4096]) if run[1] > run[0]]
    if not numbers:
        return _flip_bits(rng, data)
    start, stop = numbers[int(rng.integers(len(numbers)))]
    new = (b"-1", b"0", b"1", b"7", b"65537", b"4294967295", b"99999999999999999999", b"1e400")
    return data[:start] + new[int(rng.integers(len(new)))] + data[stop:]


def _repeat_block(rng: np.random.Generator, data: bytes) -> bytes:
    start, stop = _block(rng, data)
    return data[:stop] + data[start:stop] + data[stop:]


def _drop_block(rng: np.random.Generator, data: bytes) -> bytes:
    start, stop = _block(rng, data)
    return data[:start] + data[stop:]


def _fill_block(rng: np.random.Generator, data: bytes) -> bytes:
    """Zeros, ones, or the bits of NaN."""
    start, stop = _block(rng, data)
    filler = (b"\0", b"\xff", b"\0\0\xc0\x7f")[int(rng.integers(3))]
    return data[:start] + (filler * (stop - start))[: stop - start] + data[stop:]


_FAULTS = (
    *(_flip_bits, _flip_header_bits, _cut, _change_number),
    *(_repeat_block, _drop_block, _fill_block),
)


def _flipped(rng: np.random.Generator, data: bytes, within: int) -> bytes:
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if out:
            out[int(rng.integers(min(within, len(out))))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _block(rng: np.random.Generator, data: bytes) -> tuple[int, int]:
    start = int(rng.integers(len(data)))
    return start, min(len(data), start + int(2 ** rng.uniform(0, 11)))


def _digit_runs(data: bytes) -> Iterator[tuple[int, int]]:
    start = None
    for index, byte in enumerate(data + b" "):
        is_digit = 48 <= byte < 58
        if is_digit and start is None:
            start = index
        elif not is_digit and start is not None:
            yield start, index
            start = None


def _header(kind: str, count: int, names: tuple[str, ...] = SPLAT_NAMES) -> bytes:
    lines = ["ply", f"format {kind} 1.0", f"element vertex {count}"]
    return "\n".join([*lines, *(f"property float {n}" for n in names), "end_header\n"]).encode()


def _words(row: np.ndarray) -> str:
    return " ".join(f"{value:g}" for value in row)


def _compressed_header(count: int) -> bytes:
    words = ("position", "rotation", "scale", "color")
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {count // 256}"]
    lines += ["property float min_x", f"element vertex {count}"]
    return "\n".join(
        [*lines, *(f"property uint packed_{w}" for w in words), "end_header\n"]
    ).encode()


def _zstd_bomb() -> bytes:
    """Version 4: a megabyte of frame that unpacks to gigabytes where 9000 bytes are counted."""
    import zstandard

    out = io.BytesIO()
    with zstandard.ZstdCompressor(level=1).stream_writer(out, closefd=False) as writer:
        for _ in range(16):
            writer.write(_ZEROS)
    frame = out.getvalue()
    table = struct.pack("<QQ", len(frame), 9000)
    table += b"".join(struct.pack("<QQ", 9, 1000 * size) for size in (1, 3, 3, 4))
    head = spz_header(1000, version=4)[:15] + b"\x05" + struct.pack("<I12x", 32)
    return head + table + frame + bytes(36)


def _renamed(name: str) -> dict[str, bytes]:
    return with_meta(sog_files(), sh0={"codebook": [0.0] * 256, "files": [name]})


def _with_codebook(values: list) -> dict[str, bytes]:
    return with_meta(sog_files(), sh0={"codebook": values, "files": ["sh0.webp"]})
