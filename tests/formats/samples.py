"""Tiny valid files built byte by byte, with known contents.

Nothing here uses the package's readers or writers.
"""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from usdsplat.core.cloud import SplatCloud

SPLAT_NAMES = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
SPLAT_ROW = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0, -1.0, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0)
"""A splat with these properties: opacity 1/2, unrotated."""


def random_cloud(count: int, degree: int, seed: int = 0) -> SplatCloud:
    """Splats of all kinds, opacities well inside 0 to 1."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return SplatCloud(
        positions=rng.normal(size=(count, 3)).astype(np.float32),
        scales=np.exp(rng.normal(-3, 1, (count, 3))).astype(np.float32),
        rotations=turns.astype(np.float32),
        opacities=rng.uniform(0.01, 0.99, count).astype(np.float32),
        sh=rng.normal(size=(count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def ply(
    rows: np.ndarray, *, header: str | None = None, names: tuple[str, ...] = SPLAT_NAMES
) -> bytes:
    """A binary little endian file of float32 rows; `header` replaces the one that fits them."""
    if header is None:
        lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
        header = "\n".join([*lines, *(f"property float {name}" for name in names), "end_header\n"])
    return header.encode() + np.asarray(rows, "<f4").tobytes()


def spz_header(
    count: int, *, version: int = 2, degree: int = 0, fractional_bits: int = 12, flags: int = 0
) -> bytes:
    """The 16 bytes that all versions begin with."""
    return struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, fractional_bits, flags, 0)


def spz(payload: bytes, **header: int) -> bytes:
    """A file of version 1 to 3: header and `payload` in gzip."""
    return gzip.compress(spz_header(**header) + payload, mtime=0)


def webp(pixels: np.ndarray) -> bytes:
    """A lossless image of RGBA pixels, shape (height, width, 4)."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8), "RGBA").save(out, "WEBP", lossless=True, exact=True)
    return out.getvalue()


def declared_webp(width: int, height: int) -> bytes:
    """The first bytes of a lossless image of that size, and nothing behind them."""
    bits = (width - 1) | (height - 1) << 14
    body = b"\x2f" + struct.pack("<I", bits) + bytes(11)
    return (
        b"RIFF" + struct.pack("<I", 4 + 8 + len(body)) + b"WEBPVP8L" + struct.pack("<I", 16) + body
    )


def sog_files(seed: int = 0, *, count: int = 14, bands: int = 1) -> dict[str, bytes]:
    """Files of a version 2 SOG of random codes: 4 x 4 pixels and a palette of 64 labels."""
    rng = np.random.default_rng(seed)
    codes = {name: rng.integers(0, 256, (4, 4, 4)) for name in SOG_IMAGES}
    codes["quats"][..., 3] = rng.integers(252, 256, (4, 4))
    codes["shN_labels"][..., 0] = rng.integers(0, 64, (4, 4))
    codes["shN_labels"][..., 1] = 0
    coefficients = (bands + 1) ** 2 - 1
    codes["shN_centroids"] = rng.integers(0, 256, (1, 64 * coefficients, 4))
    meta = {
        "version": 2,
        "count": count,
        "means": {"mins": [-2, -1, 0], "maxs": [2, 3, 0.5], "files": _named("means_l", "means_u")},
        "scales": {"codebook": np.linspace(-9, -1, 256).tolist(), "files": _named("scales")},
        "quats": {"files": _named("quats")},
        "sh0": {"codebook": np.linspace(-1.5, 2, 256).tolist(), "files": _named("sh0")},
        "shN": {
            "count": 64,
            "bands": bands,
            "codebook": np.linspace(-0.5, 0.5, 256).tolist(),
            "files": _named("shN_centroids", "shN_labels"),
        },
    }
    files = {f"{name}.webp": webp(pixels) for name, pixels in codes.items()}
    return {"meta.json": json.dumps(meta).encode(), **files}


def lod_files() -> dict[str, bytes]:
    """Files of a streamed SOG: two levels, the finer one in two places, 14 splats in each file."""

    def leaf(level: int, file: int, first: int, count: int) -> dict[str, Any]:
        return {str(level): {"file": file, "offset": first, "count": count}}

    left = {"lods": leaf(0, 0, 0, 9) | leaf(1, 1, 0, 4)}
    right = {"lods": leaf(0, 0, 9, 5) | leaf(1, 1, 4, 2)}
    meta = {
        "lodLevels": 2,
        "filenames": ["0_0/meta.json", "1_0/meta.json"],
        "tree": {"bound": {"min": [-8] * 3, "max": [8] * 3}, "children": [left, right]},
    }
    files = {"lod-meta.json": json.dumps(meta).encode()}
    for folder, seed in (("0_0", 0), ("1_0", 1)):
        files |= {f"{folder}/{name}": data for name, data in sog_files(seed).items()}
    return files


SOG_IMAGES = ("means_l", "means_u", "scales", "quats", "sh0", "shN_centroids", "shN_labels")


def with_meta(files: Mapping[str, bytes], **changes: Any) -> dict[str, bytes]:
    """The files with some top-level values of meta.json replaced; None removes one."""
    meta = json.loads(files["meta.json"]) | changes
    kept = {key: value for key, value in meta.items() if value is not None}
    return {**files, "meta.json": json.dumps(kept).encode()}


def zipped(path: Path, files: Mapping[str, bytes], *, method: int = zipfile.ZIP_STORED) -> Path:
    """Write an archive of `files`."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def _named(*names: str) -> list[str]:
    return [f"{name}.webp" for name in names]
