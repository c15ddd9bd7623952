"""Parse a glTF document: JSON in, checked primitives with their transformations out.

No buffer is read here; sizes are checked against what the document declares.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core import quaternion
from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError
from usdsplat.formats.gltf.buffers import DATA_URI, BufferSpec
from usdsplat.formats.json_values import a_list, an_object, numbers, parse_object, show, whole

EXTENSION = "KHR_gaussian_splatting"
SPZ = f"{EXTENSION}_compression_spz_2"

_UNDERSTOOD = (EXTENSION, SPZ, "KHR_mesh_quantization")
_TEXT_LIMIT = 1 << 22
"""[byte] of JSON without data URIs."""
_MOST_NODES = 1 << 13
_MOST_PLACED = 1 << 10
"""Maximum number of splat primitives in a scene; one shown twice counts twice."""
_LARGEST = 1e15
"""Maximum magnitude of a number in a node's transformation."""
_MOST = 1 << 53
"""Largest range of whole numbers that every JSON implementation represents exactly."""

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
"""componentType -> dtype; vertex attributes may not be 32-bit integers."""
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

_DATA_STRING = re.compile(rb'"data:[^"\\]*"')


@dataclass(frozen=True, slots=True)
class View:
    """A buffer view: a range of bytes in a buffer."""

    buffer: int
    offset: int
    size: int
    """[byte]"""
    stride: int | None
    """Bytes from one element to the next; None if they are adjacent."""


@dataclass(frozen=True, slots=True)
class Accessor:
    """The elements of one attribute: vectors of numbers."""

    where: str
    """Names it in errors."""
    view: View
    """The bytes from the first element to the end of the last."""
    dtype: np.dtype[Any]
    width: int
    """Numbers in an element."""
    count: int
    normalized: bool
    """Whether integers are normalised to 0..1 or -1..1."""

    @property
    def stride(self) -> int:
        """Bytes from one element to the next."""
        return self.view.stride or self.width * self.dtype.itemsize


@dataclass(frozen=True, slots=True)
class Primitive:
    """The splats of one mesh primitive."""

    where: str
    """Names it in errors."""
    attributes: Mapping[str, Accessor]
    """Accessors by semantic; empty if an SPZ file holds the splats."""
    spz: View | None
    color_space: str
    kernel: str


@dataclass(frozen=True, slots=True)
class Placed:
    """A primitive with the transformation of the node that shows it."""

    primitive: Primitive
    matrix: F64
    """Primitive to scene, column vectors, shape (4, 4), finite."""


class Document:
    """A parsed glTF document; `source` names it in error messages.

    Raises:
        FormatError: If it is not glTF 2.0, or requires unsupported extensions.
    """

    def __init__(self, source: str, text: bytes) -> None:
        self._source = source
        kept: list[str] = []

        def put_by(found: re.Match[bytes]) -> bytes:
            kept.append(found.group()[1:-1].decode("ascii", "replace"))
            return b'"%s%d"' % (DATA_URI.encode(), len(kept) - 1)

        # Data URIs may be long; limiting the rest of the JSON bounds the memory of parsing it.
        text = _DATA_STRING.sub(put_by, text)
        if len(text) > _TEXT_LIMIT:
            raise FormatError(source, f"{len(text)} bytes of JSON", f"at most {_TEXT_LIMIT}")
        self._data = kept
        self._root = parse_object(source, text)
        self._meshes: dict[int, tuple[list[Primitive], int]] = {}
        self.others = 0
        """Number of placed primitives without splats."""
        self._check()

    def buffers(self) -> list[BufferSpec]:
        """Return the buffers.

        Raises:
            FormatError: If one has no size.
        """
        specs = []
        for index, value in enumerate(self._list("buffers")):
            where = f"{self._source}: buffer {index}"
            item = an_object(where, value)
            uri = item.get("uri")
            if uri is not None and not isinstance(uri, str):
                raise FormatError(f"{where}: uri", show(uri), "text")
            if uri is not None and uri.startswith(DATA_URI):
                uri = self._put_back(where, uri)
            size = whole(f"{where}: byteLength", item.get("byteLength"), 0, _MOST)
            specs.append(BufferSpec(uri, size))
        return specs

    def placed(self) -> list[Placed]:
        """Return the splat primitives of the default scene, once for each node that shows them.

        Raises:
            FormatError: If nodes form no tree or too large a one, or refer to something missing or
                invalid.
        """
        nodes, found = self._list("nodes"), []
        scene = np.eye(4)
        waiting = [(index, scene) for index in reversed(self._roots(len(nodes)))]
        seen: set[int] = set()
        while waiting:
            index, outer = waiting.pop()
            where = f"{self._source}: node {index}"
            if index in seen or len(seen) == _MOST_NODES:
                expected = f"a tree of at most {_MOST_NODES} nodes"
                raise FormatError(where, "a repeated node, or too many nodes", expected)
            seen.add(index)
            node = an_object(where, nodes[index])
            matrix = _matrix(where, node, outer)
            children = _indices(f"{where}: children", node.get("children", []), len(nodes))
            waiting += [(child, matrix) for child in reversed(children)]
            if "mesh" in node:
                found += [Placed(p, matrix) for p in self._mesh(where, node["mesh"])]
            if len(found) > _MOST_PLACED:
                raise FormatError(where, f"{len(found)} primitives", f"at most {_MOST_PLACED}")
        return found

    def _check(self) -> None:
        asset = an_object(f"{self._source}: asset", self._root.get("asset"))
        version = asset.get("version")
        if not isinstance(version, str) or not version.startswith("2."):
            raise FormatError(f"{self._source}: asset.version", show(version), "'2.0'")
        for name in self._list("extensionsRequired"):
            if name not in _UNDERSTOOD:
                where = f"{self._source}: extensionsRequired"
                raise FormatError(where, show(name), f"only {', '.join(_UNDERSTOOD)}")

    def _put_back(self, where: str, uri: str) -> str:
        number = uri.removeprefix(DATA_URI)
        if not (number.isdecimal() and len(number) < 9 and int(number) < len(self._data)):
            raise FormatError(f"{where}: uri", show(uri), "a data URI")
        return self._data[int(number)]

    def _list(self, key: str) -> list[Any]:
        return a_list(f"{self._source}: {key}", self._root.get(key, []))

    def _roots(self, nodes: int) -> list[int]:
        scenes = self._list("scenes")
        if not scenes:
            return []
        where = f"{self._source}: scene"
        index = whole(where, self._root.get("scene", 0), 0, len(scenes) - 1)
        scene = an_object(f"{where} {index}", scenes[index])
        return _indices(f"{where} {index}: nodes", scene.get("nodes", []), nodes)

    def _mesh(self, where: str, value: Any) -> list[Primitive]:
        """Return the splat primitives of a mesh; the others are only counted."""
        meshes = self._list("meshes")
        index = whole(f"{where}: mesh", value, 0, len(meshes) - 1)
        if index not in self._meshes:  # several nodes may share a mesh
            where = f"{self._source}: mesh {index}"
            items = a_list(
                f"{where}: primitives", an_object(where, meshes[index]).get("primitives")
            )
            looked = (self._primitive(f"{where}, primitive {i}", it) for i, it in enumerate(items))
            splats = [primitive for primitive in looked if primitive is not None]
            self._meshes[index] = splats, len(items) - len(splats)
        splats, others = self._meshes[index]
        self.others += others
        return splats

    def _primitive(self, where: str, value: Any) -> Primitive | None:
        """Return a primitive if it holds splats, else None."""
        item = an_object(where, value)
        extensions = an_object(f"{where}: extensions", item.get("extensions", {}))
        if EXTENSION not in extensions:
            return None
        splats = an_object(f"{where}: {EXTENSION}", extensions[EXTENSION])
        inner = an_object(f"{where}: {EXTENSION}.extensions", splats.get("extensions", {}))
        attributes, spz = {}, None
        if SPZ in inner:
            packed = an_object(f"{where}: {SPZ}", inner[SPZ])
            spz = self._view(f"{where}: {SPZ}.bufferView", packed.get("bufferView"))
        else:
            named = an_object(f"{where}: attributes", item.get("attributes"))
            attributes = {
                name: self._accessor(f"{where}: {name}", index)
                for name, index in named.items()
                if name == "POSITION" or name.startswith(f"{EXTENSION}:")
            }
        words = {key: splats.get(key, usual) for key, usual in _USUAL.items()}
        for key, word in words.items():
            if not isinstance(word, str):
                raise FormatError(f"{where}: {key}", show(word), "text")
        return Primitive(where, attributes, spz, words["colorSpace"], words["kernel"])

    def _accessor(self, where: str, value: Any) -> Accessor:
        """Return an accessor, after checking that its elements lie in its view."""
        accessors = self._list("accessors")
        item = an_object(where, accessors[whole(where, value, 0, len(accessors) - 1)])
        if "sparse" in item:
            raise FormatError(where, "a sparse accessor", "one with all its elements")
        kind, form = item.get("componentType"), item.get("type")
        if type(kind) is not int or kind not in _TYPES:
            raise FormatError(
                f"{where}: componentType", show(kind), "an 8-bit, 16-bit or float type"
            )
        if not isinstance(form, str) or form not in _WIDTHS:
            raise FormatError(f"{where}: type", show(form), "SCALAR or a vector")
        count = whole(f"{where}: count", item.get("count"), 1, _MOST)
        start = whole(f"{where}: byteOffset", item.get("byteOffset", 0), 0, _MOST)
        view = self._view(f"{where}: bufferView", item.get("bufferView"))
        dtype, width = np.dtype(_TYPES[kind]), _WIDTHS[form]
        element = dtype.itemsize * width
        stride = view.stride or element
        size = (count - 1) * stride + element
        if stride < element:
            raise FormatError(f"{where}: byteStride", f"{stride}", f"at least {element}")
        if start + size > view.size:
            found = f"{count} elements in {view.size} bytes"
            raise FormatError(where, found, f"{start + size} bytes")
        part = View(view.buffer, view.offset + start, size, stride)
        return Accessor(where, part, dtype, width, count, item.get("normalized") is True)

    def _view(self, where: str, value: Any) -> View:
        """Return a buffer view, after checking that it lies in its buffer."""
        views = self._list("bufferViews")
        item = an_object(where, views[whole(where, value, 0, len(views) - 1)])
        buffers = self._list("buffers")
        index = whole(f"{where}: buffer", item.get("buffer"), 0, len(buffers) - 1)
        buffer = an_object(f"{self._source}: buffer {index}", buffers[index])
        present = whole(f"{where}: buffer's byteLength", buffer.get("byteLength"), 0, _MOST)
        offset = whole(f"{where}: byteOffset", item.get("byteOffset", 0), 0, present)
        size = whole(f"{where}: byteLength", item.get("byteLength"), 0, present - offset)
        stride = item.get("byteStride")
        if stride is not None:
            stride = whole(f"{where}: byteStride", stride, 4, 252)
        return View(index, offset, size, stride)


_USUAL = {"colorSpace": "srgb_rec709_display", "kernel": "ellipse"}
"""Properties of the extension -> defaults, for older drafts without them."""


def _indices(where: str, value: Any, count: int) -> list[int]:
    """Return a list of indices below `count`."""
    return [whole(where, item, 0, count - 1) for item in a_list(where, value)]


def _matrix(where: str, node: Mapping[str, Any], outer: F64) -> F64:
    """Return the matrix from a node's own space to the scene."""
    if "matrix" in node:
        columns = numbers(f"{where}: matrix", node["matrix"], 16, largest=_LARGEST)
        own = columns.reshape(4, 4).T
        if own[3].tolist() != [0, 0, 0, 1]:
            raise FormatError(f"{where}: matrix", f"last row {own[3].tolist()}", "0, 0, 0, 1")
    elif node.keys() & {"translation", "rotation", "scale"}:
        own = np.eye(4)
        turn = _vector(where, node, "rotation", (0, 0, 0, 1))
        unit = quaternion.normalize(turn[None, [3, 0, 1, 2]])
        size = _vector(where, node, "scale", (1, 1, 1))
        own[:3, :3] = quaternion.to_matrix(unit)[0] * size
        own[:3, 3] = _vector(where, node, "translation", (0, 0, 0))
    else:
        return outer
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = outer @ own
    if not np.abs(matrix).max() <= _LARGEST:  # written so that NaN fails
        raise FormatError(where, "a transform out of range", f"numbers of at most {_LARGEST:g}")
    return matrix


def _vector(where: str, node: Mapping[str, Any], key: str, usual: tuple[float, ...]) -> F64:
    """Return the numbers of a node's property, or `usual` if it is absent."""
    value = node.get(key, list(usual))
    return numbers(f"{where}: {key}", value, len(usual), largest=_LARGEST)
