"""Read chunks of a splat tree: layers whose default prim is a packed or a stock float field, and
SOG files.

A layer is read without composing a stage, and only the rows that are asked for are converted.
Layers stay in USD's registry only while they are read, unless something else has them open; then
its unsaved edits are read.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Ar, Sdf, Tf

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import FormatError, StageError
from usdsplat.core.readable import readable
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.core.wording import counted
from usdsplat.formats.sog import rows as sog
from usdsplat.schema import packing, stock, tokens
from usdsplat.schema.crate_arrays import check_arrays, layer_size
from usdsplat.schema.usd_files import sentence
from usdsplat.schema.vt import as_float32, from_vt

Array = npt.NDArray[Any]

_EXPECTED = f"a default prim of type {tokens.PACKED_TYPE} or {tokens.STOCK_TYPE}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedChunk:
    """Rows of a packed chunk, not decoded."""

    positions: F32
    """Centres [local unit], shape (n, 3)."""
    arrays: packing.PackedArrays
    """The other attributes of the n splats."""


class ChunkReader:
    """Reader of the chunks of one tree, for several threads.

    It keeps some of the SOG files in memory that it has unpacked, because they are unpacked whole.

    Args:
        chunks: Resolved paths, from `Tree.chunks`.
        degree: Degree of the harmonics of the tree.
    """

    def __init__(self, chunks: Sequence[str], degree: int) -> None:
        self._chunks, self._degree, self._sog = chunks, degree, sog.SogRows()

    def read(self, chunk: int, first: int, count: int) -> SplatCloud:
        """Read rows of a chunk.

        Harmonics of a SOG of a lower degree are extended with zeros.

        Raises:
            StageError: If the chunk cannot be read, or does not have these rows.
        """
        path = self._chunks[chunk]
        if not path or not sog.is_sog(path):
            return read_chunk(path, first, count)
        with _sog_errors(path):
            return self._sog.read(path, first, count, self._degree)


def read_chunk(path: str, first: int = 0, count: int | None = None) -> SplatCloud:
    """Read rows of a chunk that is a layer.

    Args:
        path: Resolved path of the chunk, from `Tree.chunks`; "" is a missing file.
        first: First row.
        count: Number of rows; None for all from `first`.

    Raises:
        StageError: If the layer cannot be read, has no field as its default prim, or does not have
            these rows.
    """
    with _opened(path) as field:
        rows = field.rows(first, count)
        if field.is_packed:
            packed = field.packed(rows)
            return packing.unpack(packed.positions, packed.arrays)
        return field.stock(rows)


def read_packed_chunk(path: str, first: int = 0, count: int | None = None) -> PackedChunk | None:
    """Read rows of a chunk without decoding them; None if the chunk is not packed.

    Args and errors are those of `read_chunk`.
    """
    if path and sog.is_sog(path):
        return None
    with _opened(path) as field:
        return field.packed(field.rows(first, count)) if field.is_packed else None


def chunk_shape(path: str) -> tuple[int, int]:
    """Return the number of splats of a chunk and the degree of its harmonics, without reading them.

    Raises:
        StageError: If the chunk cannot be read, or is a layer without a field as its default prim.
    """
    if path and sog.is_sog(path):
        with _sog_errors(path):
            return sog.count_and_degree(path)
    with _opened(path) as field:
        return field.count, field.degree()


def check_chunk(path: str, rows: int, degree: int, whose: str) -> None:
    """Raise an error unless a chunk has what the table of its tree states; no splat is read.

    Args:
        path: Resolved path of the chunk.
        rows: Number of rows that it must have at least.
        degree: Degree of the harmonics of the tree. A SOG may have a lower one.
        whose: Which part of the tree needs the last row, such as "for node 3".

    Raises:
        StageError: If the chunk cannot be read, is too short, or has another degree.
    """
    held, found = chunk_shape(path)
    if held < rows:
        raise StageError(path, counted(held, "splat"), f"at least {rows}, {whose}")
    if found > degree or (found < degree and not sog.is_sog(path)):
        raise StageError(path, f"harmonics of degree {found}", f"{degree}, as in the tree")


def chunk_stamp(path: str) -> tuple[int, int] | None:
    """Return two numbers that change when a chunk is written, for comparisons within one process;
    None if there is no such file."""
    try:
        if sog.is_sog(path):
            return sog.stamp(path)
        state = os.stat(path)
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size


def chunk_size(path: str) -> int:
    """Return the size of the files of a chunk [byte]; 0 if it cannot be read, or is in memory."""
    if not sog.is_sog(path):
        return layer_size(path)
    try:
        return sog.file_bytes(path)
    except (FormatError, OSError):
        return 0


class _Field:
    """The default prim of a layer, whose arrays are default values of its own attributes."""

    def __init__(self, layer: Sdf.Layer, where: str) -> None:
        root = layer.GetDefaultPrimAsPath()
        self._layer, self._path, self._where = layer, root, where
        prim = layer.GetPrimAtPath(root) if not root.isEmpty else None
        name = prim.typeName if prim else ""
        if name not in (tokens.PACKED_TYPE, tokens.STOCK_TYPE):
            found = f"a prim of type {name}" if prim else "no default prim"
            raise StageError(where, found, _EXPECTED)
        self.is_packed = name == tokens.PACKED_TYPE
        centres = self._array(tokens.POSITIONS, np.float32, (3,))
        self.count = len(centres)

    def rows(self, first: int, count: int | None) -> slice:
        """Return these rows as a slice.

        Raises:
            StageError: If the field does not have them.
        """
        last = self.count if count is None else first + count
        if not 0 <= first <= last <= self.count:
            raise StageError(self._where, f"{self.count} splats", f"rows {first} to {last}")
        return slice(first, last)

    def packed(self, rows: slice) -> PackedChunk:
        """Return rows of a packed field.

        Raises:
            StageError: If the layout is not one we know, or an array is too short.
        """
        token = self._value(tokens.PACKING)
        if token not in (None, packing.TOKEN):
            raise self._wrong(tokens.PACKING, repr(token), repr(packing.TOKEN))
        degree = self.degree()
        width = packing.harmonics_width(degree)
        wide = slice(rows.start * width, rows.stop * width)
        return PackedChunk(
            positions=self._rows(tokens.POSITIONS, np.float32, (3,), rows),
            arrays=packing.PackedArrays(
                core=self._rows(tokens.PACKED, np.int32, (4,), rows),
                color_range=self._range(tokens.COLOR_RANGE, (3,), 2 if self.count else 0),
                harmonics=self._rows(tokens.PACKED_HARMONICS, np.int32, (4,), wide),
                harmonics_range=self._range(tokens.HARMONICS_RANGE, (), degree),
            ),
        )

    def stock(self, rows: slice) -> SplatCloud:
        """Return rows of a stock field, which must have all float arrays.

        Raises:
            StageError: If an array is too short.
        """
        count = coefficient_count(self.degree())
        wide = slice(rows.start * count, rows.stop * count)
        sh = self._rows(tokens.SH_COEFFICIENTS, np.float32, (3,), wide)
        return SplatCloud(
            positions=self._rows(tokens.POSITIONS, np.float32, (3,), rows),
            scales=self._rows(tokens.SCALES, np.float32, (3,), rows),
            rotations=stock.unit(self._rows(tokens.ORIENTATIONS, np.float32, (4,), rows)),
            opacities=self._rows(tokens.OPACITIES, np.float32, (), rows),
            sh=sh.reshape(-1, count, 3),
        )

    def _value(self, name: str) -> Any:
        """Return the default value of an attribute, or None."""
        path = self._path.AppendProperty(name)
        attribute = self._layer.GetAttributeAtPath(path)
        return attribute.default if attribute else None

    def degree(self) -> int:
        """Return the degree of the harmonics.

        Raises:
            StageError: If it is not 0 to 4.
        """
        found = self._value(tokens.SH_DEGREE)
        degree = tokens.SCHEMA_FALLBACK_DEGREE if found is None else found
        if not isinstance(degree, int) or not 0 <= degree <= MAX_DEGREE:
            raise self._wrong(tokens.SH_DEGREE, repr(degree), f"0 to {MAX_DEGREE}")
        return degree

    def _array(
        self, name: str, dtype: type, row: tuple[int, ...], rows: slice = slice(None)
    ) -> Array:
        """Return rows of an array; empty without a value."""
        found = self._value(name)
        if found is None:
            return np.empty((0, *row), dtype)
        is_array = hasattr(found, "__len__") and not isinstance(found, str)
        array = from_vt(found, rows) if is_array else np.empty(0, object)
        if array.dtype != dtype or array.shape[1:] != row:
            found = f"a value of type {type(found).__name__}"
            raise self._wrong(name, found, "the schema's type")
        return array

    def _rows(self, name: str, dtype: type, row: tuple[int, ...], rows: slice) -> Array:
        """Return a copy of rows of an array.

        Raises:
            StageError: If it does not have them.
        """
        array = self._array(name, dtype, row, rows)
        if len(array) != rows.stop - rows.start:
            found = f"no rows {rows.start + len(array)} to {rows.stop}"
            raise self._wrong(name, found, "a value for each splat")
        return np.array(array)  # views of the file's memory would be copied when the layer closes

    def _range(self, name: str, row: tuple[int, ...], count: int) -> F32:
        """Return the first values of an array of limits, which must be finite."""
        array = as_float32(self._rows(name, np.float32, row, slice(0, count)))
        if not np.isfinite(array).all():
            raise self._wrong(name, "a range that is not finite", "finite numbers")
        return array

    def _wrong(self, name: str, found: str, expected: str) -> StageError:
        return StageError(f"{self._where} {self._path}.{name}", found, expected)


@contextmanager
def _sog_errors(path: str) -> Iterator[None]:
    """Convert the errors of a SOG to those of other chunks.

    Raises:
        StageError: Instead of a FormatError or an OSError.
    """
    try:
        yield
    except FormatError as error:
        raise StageError(error.where, error.found, error.expected) from error
    except OSError as error:
        raise StageError(path, error.strerror or "an unreadable file", "a SOG file") from error


@contextmanager
def _opened(path: str) -> Iterator[_Field]:
    """Open the field of a chunk.

    Raises:
        StageError: If it cannot be read; instead of USD's own errors, too.
    """
    if not path:
        raise StageError("chunk", "no file", "a layer with splats")
    file = Path(Ar.SplitPackageRelativePathOuter(path)[0])
    if file.exists() and not file.is_file():  # opening a pipe would wait for ever
        raise StageError(path, "no regular file", "a layer with splats")
    check_arrays(path, is_chunk=True)
    try:
        layer = Sdf.Layer.FindOrOpen(readable(path))
        if not layer:
            raise StageError(path, "nothing that USD can read", "a layer with splats")
        yield _Field(layer, path)
    except Tf.ErrorException as error:
        raise StageError(path, sentence(error), "a layer with splats") from None
