"""Valid files of every format with seeded faults.

Each must be rejected with a one-line error or read as a finite cloud, quickly and with little
memory.
"""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.formats.gltf_samples import of_cloud, of_spz
from tests.formats.samples import (
    SPLAT_NAMES,
    SPLAT_ROW,
    lod_files,
    ply,
    random_cloud,
    sog_files,
    spz,
)

Fault = Callable[[np.random.Generator, bytes], bytes]

_ORACLES = (
    *("tiny_sh0.ply", "out.compressed.ply", "out.sog", "out_v3.spz", "out_v4.spz", "out.glb"),
    *("ours.splat", "k0.ksplat", "k1.ksplat", "k2.ksplat"),
)
"""Files that other people's code wrote."""


@dataclass(frozen=True, slots=True)
class Source:
    """A good capture."""

    name: str
    files: Mapping[str, bytes]
    """Path in its folder -> content; a single file stands alone."""
    opened: str = ""
    """What a reader is given, from the folder: the folder itself where nothing is said."""


def mutations(data: Path, out: Path, count: int, seed: int) -> Iterator[Path]:
    """Yield `count` damaged captures, the same for the same seed.

    Args:
        data: The shared test data.
        out: Where to write; a capture is left there, under its number and a telling name.
        count: Captures to make; sources take turns.
        seed: Of all choices.
    """
    rng = np.random.default_rng(seed)
    good = sources(data)
    for number in range(count):
        source = good[number % len(good)]
        fault = _FAULTS[int(rng.integers(len(_FAULTS)))]
        victim = sorted(source.files)[int(rng.integers(len(source.files)))]
        files = {**source.files, victim: _inside(rng, source.files[victim], fault)}
        path = out / f"{number:05}_{fault.__name__.strip('_')}_{source.name}"
        if len(files) == 1:
            path.write_bytes(files[victim])
            yield path
            continue
        for name, content in files.items():
            (path / name).parent.mkdir(parents=True, exist_ok=True)
            (path / name).write_bytes(content)
        yield path / source.opened if source.opened else path


def sources(data: Path) -> list[Source]:
    """Good captures, at least one of each format and version."""
    made = {name: (data / "oracle" / name).read_bytes() for name in _ORACLES}
    rows = np.array([SPLAT_ROW] * 20)
    rng = np.random.default_rng(0)
    cloud = random_cloud(7, 1)
    packed = spz(rng.bytes(30 * 28), count=30, version=2, degree=1)
    made["text.ply"] = _text_ply(rows)
    made["points.ply"] = ply(rows[:, :3], names=("x", "y", "z"))
    centres = cloud.positions.astype("<f2").tobytes()
    made["half.spz"] = spz(centres + rng.bytes(7 * 10), count=7, version=1)
    made["old.spz"] = packed
    made["few.splat"] = made["ours.splat"][: 32 * 9]
    made["small.glb"] = of_cloud(cloud).glb_bytes()
    made["packed.glb"] = of_spz(packed).glb_bytes()
    beside = of_cloud(cloud)
    beside.root["buffers"][0]["uri"] = "data.bin"
    return [
        *(Source(name, {name: content}) for name, content in made.items()),
        Source("folder", sog_files()),
        Source("old_folder", _old_sog()),
        Source("lod", lod_files()),
        Source("gltf", {"a.gltf": beside.text(), "data.bin": beside.data}, "a.gltf"),
        Source("lod_meta", lod_files(), "lod-meta.json"),
    ]


def _text_ply(rows: np.ndarray) -> bytes:
    lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    lines += [*(f"property float {name}" for name in SPLAT_NAMES), "end_header"]
    lines += [" ".join(f"{value:g}" for value in row) for row in rows]
    return "\n".join([*lines, ""]).encode()


def _old_sog() -> dict[str, bytes]:
    """Version 1: ranges where version 2 has tables."""
    files = sog_files()
    meta = json.loads(files["meta.json"])
    del meta["version"], meta["count"]
    meta["means"]["shape"] = [14, 3]
    for name, channels in (("scales", 3), ("sh0", 4)):
        del meta[name]["codebook"]
        meta[name] |= {"mins": [-4.0] * channels, "maxs": [2.0] * channels}
    meta["shN"] = {"mins": -1, "maxs": 1, "files": meta["shN"]["files"]}
    return {**files, "meta.json": json.dumps(meta).encode()}


def _inside(rng: np.random.Generator, data: bytes, fault: Fault) -> bytes:
    """Apply `fault` to the file, or half the time to what a container holds."""
    if rng.random() < 0.5:
        return fault(rng, data)
    if data[:2] == b"\x1f\x8b":
        return gzip.compress(fault(rng, gzip.decompress(data)), 1, mtime=0)
    if data[:4] == b"glTF":
        return _in_chunk(rng, data, fault)
    if data[:2] == b"PK":
        return _in_archive(rng, data, fault)
    return fault(rng, data)


def _in_archive(rng: np.random.Generator, data: bytes, fault: Fault) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    victim = "meta.json" if rng.random() < 0.5 else str(rng.choice(sorted(files)))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)  # of a fixed date
            archive.writestr(entry, fault(rng, content) if name == victim else content)
    return out.getvalue()


def _in_chunk(rng: np.random.Generator, data: bytes, fault: Fault) -> bytes:
    """Damage a document, or the binary chunk, under lengths that stay true."""
    size = struct.unpack_from("<I", data, 12)[0]
    parts = {b"JSON": data[20 : 20 + size], b"BIN\0": data[28 + size :]}
    victim = b"JSON" if rng.random() < 0.7 else b"BIN\0"
    parts[victim] = fault(rng, parts[victim])
    body = b"".join(struct.pack("<I4s", len(part), kind) + part for kind, part in parts.items())
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _flip_bits(rng: np.random.Generator, data: bytes) -> bytes:
    return _flipped(rng, data, len(data))


def _flip_header_bits(rng: np.random.Generator, data: bytes) -> bytes:
    return _flipped(rng, data, 64)


def _cut(rng: np.random.Generator, data: bytes) -> bytes:
    return data[: int(rng.integers(len(data)))] if data else data


def _change_number(rng: np.random.Generator, data: bytes) -> bytes:
    """Replace one of the decimal numbers near the start."""
    numbers = list(_digit_runs(data[:4096]))
    if not numbers:
        return _flip_bits(rng, data)
    start, stop = numbers[int(rng.integers(len(numbers)))]
    new = (b"-1", b"0", b"1", b"7", b"65537", b"4294967295", b"99999999999999999999", b"1e400")
    return data[:start] + new[int(rng.integers(len(new)))] + data[stop:]


def _set_word(rng: np.random.Generator, data: bytes) -> bytes:
    """Overwrite an aligned word, the sooner the likelier, with one that programs stumble over."""
    words = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000, 0x7F800000, 0xFF7FFFFF)
    at = int(2 ** rng.uniform(0, np.log2(len(data) + 1))) // 4 * 4
    return data[:at] + struct.pack("<I", words[int(rng.integers(len(words)))]) + data[at + 4 :]


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


def _change_json(rng: np.random.Generator, data: bytes) -> bytes:
    """Exchange or drop one value somewhere in a document."""
    if data[:1] != b"{":
        return _set_word(rng, data)
    root = json.loads(data)
    holder, key = {"": root}, ""
    while rng.random() < 0.85:  # one level deeper
        inner: Any = holder[key]
        keys = list(inner) if isinstance(inner, dict) else list(range(len(_items(inner))))
        if not keys:
            break
        holder, key = inner, keys[int(rng.integers(len(keys)))]
    odd = (None, True, -1, 0, 1, 65537, 1 << 53, 10**30, 0.5, 1e308, float("nan"), "", "a\0b", "..",
           "\ud800", [], {}, [[]], ["0"], {"": 0}, [1e308] * 3, [0] * 256)  # fmt: skip
    choice = int(rng.integers(len(odd) + 1))
    if choice < len(odd):
        holder[key] = odd[choice]
    elif key != "":
        del holder[key]
    return json.dumps(root).encode()


_FAULTS = (
    *(_flip_bits, _flip_header_bits, _cut, _change_number, _set_word),
    *(_repeat_block, _drop_block, _fill_block, _change_json),
)


def _items(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _flipped(rng: np.random.Generator, data: bytes, within: int) -> bytes:
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if out:
            out[int(rng.integers(min(within, len(out))))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _block(rng: np.random.Generator, data: bytes) -> tuple[int, int]:
    start = int(rng.integers(len(data) + 1))
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
