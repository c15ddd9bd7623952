"""Small glTF documents built by hand, with known contents.

Nothing here uses the package's reader or writer.
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from usdsplat.core.cloud import SplatCloud

SPLATS = "KHR_gaussian_splatting"
SPZ = f"{SPLATS}_compression_spz_2"
_KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "f4": 5126}
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


class Gltf:
    """A document under construction: one mesh, one primitive, one node that shows it."""

    def __init__(self) -> None:
        self.data = b""
        self.root: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "extensionsUsed": [SPLATS],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}, "mode": 0, "extensions": {SPLATS: {}}}]}],
            "buffers": [{"byteLength": 0}],
            "bufferViews": [],
            "accessors": [],
        }

    @property
    def primitive(self) -> dict[str, Any]:
        """The primitive's own object."""
        return self.root["meshes"][0]["primitives"][0]

    def accessor_of(self, name: str) -> dict[str, Any]:
        """The accessor of an attribute."""
        return self.root["accessors"][self.primitive["attributes"][name]]

    def view(self, data: bytes, **more: Any) -> int:
        """Append bytes; returns the index of their view."""
        at = len(self.data)
        self.data += data + bytes(-len(data) % 4)
        view = {"buffer": 0, "byteOffset": at, "byteLength": len(data), **more}
        self.root["bufferViews"].append(view)
        self.root["buffers"][0]["byteLength"] = len(self.data)
        return len(self.root["bufferViews"]) - 1

    def add(self, name: str, values: np.ndarray, *, normalized: bool = False) -> None:
        """Add an attribute of values of shape (n, width), or exchange it."""
        count, width = values.shape
        accessor = {
            "bufferView": self.view(values.tobytes()),
            "componentType": _KINDS[values.dtype.str[1:]],
            "count": count,
            "type": _TYPES[width],
        }
        if normalized:
            accessor["normalized"] = True
        self.root["accessors"].append(accessor)
        self.primitive["attributes"][name] = len(self.root["accessors"]) - 1

    def text(self) -> bytes:
        """The JSON as it is."""
        return json.dumps(self.root).encode()

    def glb_bytes(self) -> bytes:
        """All of it in one binary file."""
        text = self.text()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def glb(self, path: Path) -> Path:
        """Write all of it into one binary file."""
        path.write_bytes(self.glb_bytes())
        return path

    def beside(self, path: Path, uri: str = "data.bin") -> Path:
        """Write the text and a file of data."""
        self.root["buffers"][0]["uri"] = uri
        (path.parent / uri).write_bytes(self.data)
        path.write_bytes(self.text())
        return path

    def alone(self, path: Path) -> Path:
        """Write the text with the data in it."""
        body = base64.b64encode(self.data).decode()
        self.root["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{body}"
        path.write_bytes(self.text())
        return path


def of_cloud(cloud: SplatCloud) -> Gltf:
    """Float attributes of a cloud, as the extension has them."""
    out = Gltf()
    out.add("POSITION", cloud.positions)
    out.add(f"{SPLATS}:ROTATION", np.roll(cloud.rotations, -1, axis=1))
    out.add(f"{SPLATS}:SCALE", cloud.scales)
    out.add(f"{SPLATS}:OPACITY", cloud.opacities[:, None])
    index = 0
    for degree in range(cloud.sh_degree + 1):
        for order in range(2 * degree + 1):
            out.add(f"{SPLATS}:SH_DEGREE_{degree}_COEF_{order}", cloud.sh[:, index].copy())
            index += 1
    return out


def of_spz(data: bytes) -> Gltf:
    """A primitive whose splats are an SPZ file."""
    out = Gltf()
    out.primitive["extensions"][SPLATS] = {"extensions": {SPZ: {"bufferView": out.view(data)}}}
    return out
