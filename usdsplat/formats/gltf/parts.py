"""Decode the splats of one glTF primitive into a cloud.

Source: Khronos, KHR_gaussian_splatting as ratified in 2026, with linear scales. Earlier drafts
stored logarithms, which are assumed if a scale is negative. The draft
KHR_gaussian_splatting_compression_spz_2 converts between axes "luf" and SPZ's own.
"""

from __future__ import annotations

import io
import math
import threading
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import fields, replace

import numpy as np

from usdsplat.core import axes, edit, quaternion
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.formats import spz
from usdsplat.formats.cloud_builder import BLOCK, CloudBuilder, in_parallel
from usdsplat.formats.gltf.buffers import Buffers
from usdsplat.formats.gltf.document import EXTENSION, Accessor, Primitive, View
from usdsplat.formats.inflate import BYTES_PER_SPLAT, TRUSTED_COUNT
from usdsplat.formats.options import READ_OPTIONS
from usdsplat.formats.spz.container import open_container

SEMANTICS = {
    "positions": ("POSITION", 3),
    "rotations": (f"{EXTENSION}:ROTATION", 4),
    "scales": (f"{EXTENSION}:SCALE", 3),
    "opacities": (f"{EXTENSION}:OPACITY", 1),
}
"""Field of the cloud -> (name of its attribute, numbers in an element)."""

Told = Callable[[int], None]
"""Callback that receives the number of finished rows."""

_FIELDS = ("positions", "scales", "rotations", "opacities", "sh")
# Default of the SPZ library; a file may state another.
_SPZ_FRAME = "rub"


def coefficient_name(index: int) -> str:
    """Return the attribute name of coefficient `index` of the harmonics, degree 0 included."""
    degree = math.isqrt(index)
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{index - degree * degree}"


class Part(ABC):
    """The splats of a primitive, which may be shown several times."""

    count: int
    degree: int
    error_bounds: Mapping[str, str]
    """As in `Capture.error_bounds`."""
    notes: Counter[str]
    """Note -> number of splats or primitives that it applies to."""

    @abstractmethod
    def fill(self, builder: CloudBuilder, start: int, matrix: F64, told: Told) -> None:
        """Decode all splats into the rows from `start`, transformed by an affine map.

        Args:
            builder: Cloud under construction, with room for these splats.
            start: First row to fill.
            matrix: Primitive to scene, column vectors, shape (4, 4).
            told: Receives the number of finished rows.

        Raises:
            FormatError: If the data is damaged or a number is not finite.
        """


def open_part(primitive: Primitive, buffers: Buffers) -> Part:
    """Open a primitive.

    Raises:
        FormatError: If attributes are missing or have a wrong count or type, or if the buffers are
            shorter than the document declares.
    """
    if primitive.spz is not None:
        return _Packed(primitive.where, primitive.spz, buffers)
    return _Attributes(primitive, buffers)


class _Attributes(Part):
    """A primitive with one accessor per attribute."""

    def __init__(self, primitive: Primitive, buffers: Buffers) -> None:
        self._buffers = buffers
        self._own: dict[str, Accessor] = {}
        for field, (name, width) in SEMANTICS.items():
            self._own[field] = self._accessor(primitive, name, width)
        present = [
            index
            for index in range(coefficient_count(MAX_DEGREE))
            if coefficient_name(index) in primitive.attributes
        ]
        self.degree = math.isqrt(max(present, default=0))
        names = [coefficient_name(i) for i in range(coefficient_count(self.degree))]
        self._sh = [self._accessor(primitive, name, 3) for name in names]
        self._names = {"sh": names, **{field: [name] for field, (name, _) in SEMANTICS.items()}}
        self.count = self._own["positions"].count
        for accessor in (*self._own.values(), *self._sh):
            if accessor.count != self.count:
                raise FormatError(accessor.where, f"{accessor.count} elements", f"{self.count}")
        self.error_bounds = {
            field: _bound(accessor)
            for field, accessor in (*self._own.items(), ("sh", self._sh[0]))
            if accessor.dtype.kind != "f"
        }
        self.notes = Counter()
        self._lock = threading.Lock()
        self._logarithms = any(
            (self._read(self._own["scales"], first, min(BLOCK, self.count - first)) < 0).any()
            for first in range(0, self.count, BLOCK)
        )
        if self._logarithms:
            said = "primitives whose scales are assumed to be logarithms, because some are negative"
            self.notes[said] += 1

    def fill(self, builder: CloudBuilder, start: int, matrix: F64, told: Told) -> None:
        def work(rows: slice) -> None:
            first, size = rows.start, rows.stop - rows.start
            into = slice(start + first, start + rows.stop)
            for field, accessor in self._own.items():
                values = self._read(accessor, first, size)
                getattr(builder, field)[into] = _ordered(field, values)
            for index, accessor in enumerate(self._sh):
                builder.sh[into, index] = self._read(accessor, first, size)
            builder.sh[into, len(self._sh) :] = 0
            self._activate(builder, into)
            _carry(builder, into, matrix)
            builder.settle(into, self._name)

        in_parallel(self.count, work, told=told)

    def _accessor(self, primitive: Primitive, name: str, width: int) -> Accessor:
        """Return an accessor, after checking that its buffer is complete."""
        accessor = primitive.attributes.get(name)
        if accessor is None:
            raise FormatError(primitive.where, f"no attribute {name}", "one")
        if accessor.width != width:
            found = f"{accessor.width} numbers an element"
            raise FormatError(accessor.where, found, f"{width}")
        self._buffers.size(accessor.view.buffer)
        return accessor

    def _read(self, accessor: Accessor, first: int, size: int) -> F32:
        """Read elements as float32, shape (size, width)."""
        element = accessor.dtype.itemsize * accessor.width
        offset = accessor.view.offset + first * accessor.stride
        span = (size - 1) * accessor.stride + element
        data = self._buffers.read(accessor.view.buffer, offset, span)
        strides = (accessor.stride, accessor.dtype.itemsize)
        codes = np.ndarray((size, accessor.width), accessor.dtype, data, 0, strides)
        values = codes.astype(np.float32)
        if accessor.normalized and accessor.dtype.kind != "f":
            values /= np.iinfo(accessor.dtype).max
            np.maximum(values, -1, out=values)  # the most negative code maps below -1
        return values

    def _activate(self, builder: CloudBuilder, rows: slice) -> None:
        """Undo logarithms of draft versions, and clamp opacities out of range."""
        if self._logarithms:
            with np.errstate(over="ignore", invalid="ignore"):  # `settle` reports infinities
                np.exp(builder.scales[rows], out=builder.scales[rows])
        opacities = builder.opacities[rows]
        beyond = int(np.count_nonzero((opacities < 0) | (opacities > 1)))
        if beyond:
            with self._lock:
                self.notes["opacities outside 0 to 1, clamped"] += beyond
            np.clip(opacities, 0, 1, out=opacities)

    def _name(self, field: str, column: int) -> str:
        names = self._names[field]
        return names[min(column // 3, len(names) - 1)] if field == "sh" else names[0]


class _Packed(Part):
    """A primitive whose splats are an SPZ file in a buffer view."""

    def __init__(self, where: str, view: View, buffers: Buffers) -> None:
        self._where = where
        self._view = view
        self._buffers = buffers
        buffers.size(view.buffer)
        data = self._data()
        header = open_container(where, io.BytesIO(data), len(data)).header
        # Half the limit of a separate SPZ file, because the decoded SPZ cloud and the whole scene's
        # cloud are in memory together.
        most = max(TRUSTED_COUNT // 2, len(data) // BYTES_PER_SPLAT)
        if header.count > most:
            found = f"{header.count} splats in {len(data)} bytes"
            raise FormatError(where, found, f"at most {most}")
        self.count, self.degree = header.count, header.degree
        self.error_bounds = {}
        self.notes = Counter()

    def fill(self, builder: CloudBuilder, start: int, matrix: F64, told: Told) -> None:
        data = self._data()
        capture = spz.unpack(self._where, io.BytesIO(data), len(data), READ_OPTIONS)
        self.error_bounds = capture.error_bounds
        stated = capture.frame if capture.states_frame else _SPZ_FRAME
        turn = np.eye(4)
        turn[:3, :3] = axes.change(stated, "luf")
        whole, cloud = matrix @ turn, capture.cloud

        def work(rows: slice) -> None:
            into = slice(start + rows.start, start + rows.stop)
            for field in ("positions", "scales", "rotations", "opacities"):
                getattr(builder, field)[into] = getattr(cloud, field)[rows]
            own = cloud.sh.shape[1]
            builder.sh[into, :own] = cloud.sh[rows]
            builder.sh[into, own:] = 0
            _carry(builder, into, whole)
            builder.settle(into)

        in_parallel(len(cloud), work, told=told)

    def _data(self) -> bytes:
        return self._buffers.read(self._view.buffer, self._view.offset, self._view.size)


def _ordered(field: str, values: F32) -> F32:
    """Return the elements of an attribute in the cloud's order and shape."""
    if field == "rotations":
        return values[:, [3, 0, 1, 2]]
    return values[:, 0] if field == "opacities" else values


def _bound(accessor: Accessor) -> str:
    """Return the rounding error of an integer attribute."""
    return f"1/{2 * np.iinfo(accessor.dtype).max}" if accessor.normalized else "1/2"


def _carry(builder: CloudBuilder, rows: slice, matrix: F64) -> None:
    """Transform rows that are filled but not settled yet by an affine map."""
    if np.array_equal(matrix, np.eye(4)):
        return
    cloud = SplatCloud(**{field: getattr(builder, field)[rows] for field in _FIELDS})
    sound = np.asarray(cloud.rotations.any(axis=1))
    for field in fields(cloud):
        values = getattr(cloud, field.name)
        if values is not None:
            sound &= np.isfinite(values).reshape(len(cloud), -1).all(axis=1)
    kept = edit.take(cloud, sound)  # `settle` reports or drops the others
    with np.errstate(all="ignore"):  # `settle` reports infinities
        moved = edit.transform(
            replace(kept, rotations=quaternion.normalize(kept.rotations)), matrix
        )
    for name in _FIELDS:
        getattr(cloud, name)[sound] = getattr(moved, name)
