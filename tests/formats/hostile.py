"""Malicious files, such as decompression bombs, built in memory."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tests.formats.gltf_samples import Gltf, of_cloud, of_spz
from tests.formats.samples import (
    SPLAT_NAMES,
    declared_webp,
    lod_files,
    random_cloud,
    sog_files,
    spz,
    spz_header,
    with_meta,
    zipped,
)
from usdsplat.formats.sog.lod_meta import LOD_META_LIMIT

GIGABYTE = 1 << 30
_ZEROS = bytes(1 << 24)


def bombs(folder: Path) -> list[Path]:
    """Write every bomb into `folder`, about 130 MB in all, and return their paths.

    Each ends in the suffix of the format that it pretends to be, or is a folder of files.
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
        "lod_climbs": _lod(filenames=["../../0_0/meta.json"]),
        "lod_claims": _lod(tree={"lods": {"0": {"file": 0, "offset": 0, "count": 1 << 32}}}),
        "lod_deep": {**lod_files(), "lod-meta.json": b'{"tree":' * 100_000},
        "lod_nested": {**lod_files(), "lod-meta.json": b'{"tree":' + b'{"children":[' * 100_000},
        "lod_leaves": _long_lod(json.dumps(_leaf(number)) for number in range(80_000)),
        "lod_nodes": _long_lod(["{}"] * 400_000),
        "lod_keys": _long_lod((f'"{number}":0' for number in range(600_000)), "{", "}"),
        "lod_wide": _long_lod(['{"\U0001f600":1}'] * 3_000_000),
        "odd.splat": bytes(33),
        "sections.ksplat": _ksplat(rooms=(1 << 32) - 1),
        "splats.ksplat": _ksplat(splats=(1 << 32) - 1),
        "zeros_inside.glb": of_spz(zeros_in_gzip(spz_header(1000, degree=3), GIGABYTE)).glb_bytes(),
        "zeros_that_fit.glb": of_spz(
            zeros_in_gzip(spz_header(1 << 20, degree=3), 1 << 26)
        ).glb_bytes(),
        "many_scenes.glb": _gltf(nodes=[{"mesh": 0}] * (1 << 15)).glb_bytes(),
        "long_tree.gltf": _gltf(nodes=[{"children": [i + 1]} for i in range(1 << 17)]).text(),
        "long_json.gltf": b'{"asset":{"version":"2.0"},"a":[' + b"[]," * (1 << 24) + b"0]}",
        "many_values.gltf": b'{"asset":{"version":"2.0"},"a":[' + b"{}," * 1_398_000 + b"0]}",
        "deep_json.gltf": b'{"asset":{"version":"2.0"},"a":' + b"[" * (1 << 21),
        "claims.glb": _gltf(buffers=[{"byteLength": 1 << 50}]).glb_bytes(),
        "climbing.gltf": _gltf(buffers=[{"byteLength": 9, "uri": "../../secret"}]).text(),
    }
    paths = []
    for name, content in made.items():
        path = folder / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif path.suffix:
            zipped(path, content, method=zipfile.ZIP_DEFLATED)
        else:
            for file, data in content.items():
                (path / file).parent.mkdir(parents=True, exist_ok=True)
                (path / file).write_bytes(data)
        paths.append(path)
    return paths


def zeros_in_gzip(start: bytes, size: int = 2 * GIGABYTE) -> bytes:
    """A gzip file of `start` and `size` zeros, a thousandth as long."""
    pack = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    first = pack.compress(start) + pack.flush(zlib.Z_FULL_FLUSH)
    middle = pack.compress(_ZEROS) + pack.flush(zlib.Z_FULL_FLUSH)  # may be repeated as it is
    times, rest = divmod(size, len(_ZEROS))
    check = zlib.crc32(start)
    for _ in range(times):
        check = zlib.crc32(_ZEROS, check)
    last = pack.compress(bytes(rest)) + pack.flush()
    tail = struct.pack("<II", zlib.crc32(bytes(rest), check), (len(start) + size) & 0xFFFFFFFF)
    return b"\x1f\x8b\x08" + bytes(6) + b"\xff" + first + middle * times + last + tail


def _header(kind: str, count: int, names: tuple[str, ...] = SPLAT_NAMES) -> bytes:
    lines = ["ply", f"format {kind} 1.0", f"element vertex {count}"]
    return "\n".join([*lines, *(f"property float {n}" for n in names), "end_header\n"]).encode()


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


def _lod(**changes: Any) -> dict[str, bytes]:
    """A streamed SOG some of whose values are others."""
    files = lod_files()
    meta = json.loads(files["lod-meta.json"]) | changes
    return {**files, "lod-meta.json": json.dumps(meta).encode()}


def _leaf(number: int) -> dict[str, Any]:
    """A leaf with a splat in each of seven levels."""
    lods = {str(k): {"file": k, "offset": number, "count": 1} for k in range(7)}
    return {"lods": lods, "bound": {"min": [-1.25, -1.5, -1.75], "max": [1.25, 1.5, 1.75]}}


def _long_lod(
    items: Iterable[str], before: str = '{"children":[', after: str = "]}"
) -> dict[str, bytes]:
    """A streamed SOG with items in one node, and without its files."""
    names = json.dumps([f"{level}.sog" for level in range(7)])
    text = f'{{"version":1,"lodLevels":7,"filenames":{names},"tree":{before}{",".join(items)}'
    made = f"{text}{after}}}".encode()
    assert len(made) <= LOD_META_LIMIT  # or it is not parsed
    return {"lod-meta.json": made}


def _ksplat(*, rooms: int = 1, splats: int = 1) -> bytes:
    """Headers of a file without compression, and no data."""
    head = struct.pack("<BBxx4IH", 0, 1, rooms, 1, splats, splats, 0)
    return head.ljust(4096, b"\0") + struct.pack("<I", splats).ljust(1024, b"\0")


def _gltf(**changes: Any) -> Gltf:
    """A document some of whose values are others."""
    sample = of_cloud(random_cloud(9, 0))
    sample.root |= changes
    if "nodes" in changes:
        sample.root["scenes"] = [{"nodes": list(range(len(changes["nodes"])))}]
    return sample
