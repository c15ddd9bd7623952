"""GLB: binary glTF 2.0 with splats in `KHR_gaussian_splatting`.

Reads the layouts that `gltf.parts` describes. Writes float attributes one after the other, and a
colour for viewers that support points only. Lossless except for ids, velocities and the antialiased
flag, which glTF cannot hold, and degree 4, which the extension does not define.

Source: Khronos, glTF 2.0 specification and extension KHR_gaussian_splatting. Axes and unit are
glTF's own: y up, metres.
"""

from __future__ import annotations

import json
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.encoding import quantize
from usdsplat.core.errors import FormatError, OutputError, UsageError
from usdsplat.core.output import output_file
from usdsplat.core.sh import dc_to_rgb
from usdsplat.formats.capture import Capture
from usdsplat.formats.cloud_builder import in_parallel
from usdsplat.formats.gltf.buffers import BinaryChunk
from usdsplat.formats.gltf.document import EXTENSION
from usdsplat.formats.gltf.parts import SEMANTICS, coefficient_name
from usdsplat.formats.gltf.splats import FRAME, METERS_PER_UNIT, SRGB, TEXT_LIMIT, read_splats
from usdsplat.formats.options import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions

SUFFIXES: tuple[str, ...] = (".glb",)

MAGIC = b"glTF"
MAX_DEGREE = 3
"""Highest degree of harmonics that the extension defines."""

_HEADER = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")
_LARGEST = (1 << 32) - (1 << 20)
"""Maximum size of the binary chunk [byte]: the 32-bit file length also counts the JSON, which is
far shorter than the remainder."""
_FLOAT, _BYTE = 5126, 5121
_VERTICES = 34962
_POINTS = 0
_COLOR = "COLOR_0"
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}

__all__ = ["FRAME", "MAX_DEGREE", "METERS_PER_UNIT", "SUFFIXES", "read", "recognises", "write"]


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file that starts with `head` is binary glTF."""
    return head.startswith(MAGIC)


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read all splats of the default scene.

    Raises:
        FormatError: If a chunk is longer than the file, the document is damaged or refers to
            something missing, or the scene shows no splats.
    """
    source, present = str(path), path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER.size + _CHUNK.size)
        if len(head) < _HEADER.size + _CHUNK.size:
            raise FormatError(source, f"a header of {len(head)} bytes", "20")
        magic, version, length = _HEADER.unpack_from(head)
        if magic != MAGIC or version != 2:
            raise FormatError(source, f"{magic!r}, version {version}", f"{MAGIC!r}, version 2")
        if length > present:
            raise FormatError(source, f"{present} bytes", f"{length}, as declared by its header")
        size, kind = _CHUNK.unpack_from(head, _HEADER.size)
        if kind != b"JSON" or size > min(TEXT_LIMIT, length - len(head)):
            found = f"a chunk {kind!r} of {size} bytes where {length - len(head)} are left"
            raise FormatError(source, found, f"b'JSON' of at most {TEXT_LIMIT}")
        text = file.read(size)
        head = file.read(_CHUNK.size)
    start = _HEADER.size + 2 * _CHUNK.size + len(text)
    chunk = BinaryChunk(start, 0)
    if len(head) == _CHUNK.size and start <= length:
        size, kind = _CHUNK.unpack(head)
        if kind == b"BIN\0":
            if size > length - start:
                found = f"a binary chunk of {size} bytes where {length - start} are left"
                raise FormatError(source, found, "a whole one")
            chunk = BinaryChunk(start, size)
    return read_splats(path, text, chunk, how)


def write(cloud: SplatCloud, path: Path, how: WriteOptions = WRITE_OPTIONS) -> Mapping[str, str]:
    """Write `cloud` as one primitive.

    Args:
        cloud: At least one splat, all finite, harmonics up to degree 3, in glTF's axes.
        path: Target, replaced when the file is complete.
        how: Its `frame` must be glTF's or None.

    Returns:
        Error bounds, in the form of `Capture.error_bounds`.

    Raises:
        UsageError: If the cloud does not meet these conditions.
        OutputError: If the target cannot be written, or the data exceeds the size limit of a .glb.
    """
    attributes = _attributes(cloud)
    ends = list(accumulate(attribute.size * len(cloud) for attribute in attributes))
    if ends[-1] > _LARGEST:
        found = f"{len(cloud)} splats in {ends[-1]} bytes"
        raise OutputError(str(path), found, f"at most {_LARGEST} in a .glb")
    _check(cloud, path, how)
    text = json.dumps(_document(cloud, attributes, ends), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    start = _HEADER.size + 2 * _CHUNK.size + len(text)
    with output_file(path) as output, output.open() as file:
        file.write(_HEADER.pack(MAGIC, 2, start + ends[-1]))
        file.write(_CHUNK.pack(len(text), b"JSON") + text)
        file.write(_CHUNK.pack(ends[-1], b"BIN\0"))
        lock = threading.Lock()

        def work(rows: slice) -> None:
            for attribute, end in zip(attributes, ends, strict=True):
                data = np.ascontiguousarray(attribute.rows(rows))
                with lock:
                    file.seek(start + end - attribute.size * (len(cloud) - rows.start))
                    file.write(data.data)

        in_parallel(
            len(cloud),
            work,
            told=lambda done: how.progress.step(f"writing {path}", done, len(cloud)),
        )
    return {}


@dataclass(frozen=True, slots=True)
class _Attribute:
    """An attribute of all splats."""

    name: str
    width: int
    """Numbers in an element."""
    rows: Callable[[slice], npt.NDArray[Any]]
    """Function that returns elements, shape (rows, width): float32, or uint8 for the colour."""

    @property
    def is_color(self) -> bool:
        return self.name == _COLOR

    @property
    def size(self) -> int:
        """Size of an element [byte]."""
        return self.width * (1 if self.is_color else 4)


def _attributes(cloud: SplatCloud) -> list[_Attribute]:
    """Return all attributes to write, in the order of the file."""
    rows: dict[str, Callable[[slice], npt.NDArray[Any]]] = {
        "positions": lambda rows: cloud.positions[rows],
        "rotations": lambda rows: cloud.rotations[rows][:, [1, 2, 3, 0]],
        "scales": lambda rows: cloud.scales[rows],
        "opacities": lambda rows: cloud.opacities[rows],
    }
    own = [_Attribute(name, width, rows[field]) for field, (name, width) in SEMANTICS.items()]
    harmonics = [
        _Attribute(coefficient_name(index), 3, partial(_coefficient, cloud, index))
        for index in range(cloud.sh.shape[1])
    ]
    return [*own, *harmonics, _Attribute(_COLOR, 4, lambda rows: _colors(cloud, rows))]


def _coefficient(cloud: SplatCloud, index: int, rows: slice) -> F32:
    return cloud.sh[rows, index]


def _colors(cloud: SplatCloud, rows: slice) -> npt.NDArray[np.uint8]:
    """Return colours for viewers that support points only: degree 0 and opacity as bytes."""
    rgb = dc_to_rgb(cloud.sh[rows, 0])
    return quantize(np.column_stack([rgb, cloud.opacities[rows]]), 0, 1, 255).astype(np.uint8)


def _document(
    cloud: SplatCloud, attributes: Sequence[_Attribute], ends: Sequence[int]
) -> dict[str, Any]:
    """Return the JSON of a scene with one primitive; `ends` are the end offsets of the
    attributes."""
    sizes = [attribute.size * len(cloud) for attribute in attributes]
    views = [
        {"buffer": 0, "byteOffset": end - size, "byteLength": size, "target": _VERTICES}
        for end, size in zip(ends, sizes, strict=True)
    ]
    accessors: list[dict[str, Any]] = [
        {
            "bufferView": index,
            "componentType": _BYTE if attribute.is_color else _FLOAT,
            "count": len(cloud),
            "type": _TYPES[attribute.width],
        }
        for index, attribute in enumerate(attributes)
    ]
    accessors[0] |= {edge: _edge(cloud, edge) for edge in ("min", "max")}  # glTF requires them
    accessors[-1]["normalized"] = True
    splats = {
        "kernel": "ellipse",
        "colorSpace": SRGB,
        "sortingMethod": "cameraDistance",
        "projection": "perspective",
    }
    primitive = {
        "attributes": {attribute.name: index for index, attribute in enumerate(attributes)},
        "mode": _POINTS,
        "extensions": {EXTENSION: splats},
    }
    return {
        "asset": {"version": "2.0", "generator": "usdsplat"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": ends[-1]}],
    }


def _edge(cloud: SplatCloud, edge: str) -> list[float]:
    """Return the minimum or maximum position on each axis."""
    return [float(value) for value in getattr(cloud.positions, edge)(axis=0)]


def _check(cloud: SplatCloud, path: Path, how: WriteOptions) -> None:
    """Raise an error if glTF cannot hold the cloud."""
    where = str(path)
    if how.frame not in (None, FRAME):
        raise UsageError(where, f"frame {how.frame!r}", f"{FRAME!r}: glTF fixes its axes")
    if cloud.sh_degree > MAX_DEGREE:
        expected = f"at most {MAX_DEGREE} in glTF: cut the harmonics first"
        raise UsageError(where, f"harmonics of degree {cloud.sh_degree}", expected)
    if not len(cloud):
        raise UsageError(where, "no splats", "at least one: glTF allows no empty arrays")
