"""The splats of a chunk that is a layer: its default prim, a packed or a stock float field.

The layer is read without composing a stage. It stays in USD's registry only while it is read,
unless something else has it open; then its unsaved edits are read.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Ar, Sdf, Tf

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.readable import readable
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.schema import packing, stock, tokens
from usdsplat.schema.crate_arrays import check_arrays
from usdsplat.schema.usd_files import sentence
from usdsplat.schema.vt import as_float32, from_vt

Array = npt.NDArray[Any]

_OURS, _DIGEST = "usdsplat", "digest"
"""Keys in the customLayerData of a chunk, "usdsplat:digest" in USD's spelling."""
_DIGITS = 32
_EXPECTED = f"a default prim of type {tokens.PACKED_TYPE} or {tokens.STOCK_TYPE}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedChunk:
    """Rows of a packed chunk, not decoded."""

    positions: F32
    """Centres [local unit], shape (n, 3)."""
    arrays: packing.PackedArrays
    """The other attributes of the n splats."""


class ChunkField:
    """The default prim of a layer, whose arrays are default values of its own attributes.

    It has the layer until `close`: tracebacks of errors keep it longer.
    """

    def __init__(self, layer: Sdf.Layer, where: str) -> None:
        self._layer, self._path, self._where = layer, layer.GetDefaultPrimAsPath(), where
        self.is_packed = False
        self.count = 0

    def check(self, digest: str) -> None:
        """Find out what the field is; it must state the digest, unless that is "".

        Raises:
            StageError: If the default prim is no field, or states another digest.
        """
        root = self._path
        prim = self._layer.GetPrimAtPath(root) if not root.isEmpty else None
        name = prim.typeName if prim else ""
        if name not in (tokens.PACKED_TYPE, tokens.STOCK_TYPE):
            found = f"a prim of type {name}" if prim else "no default prim"
            raise StageError(self._where, found, _EXPECTED)
        if digest and (stated := self._stated_digest()) != digest:
            found = "the splats of another chunk" if stated else "splats without a digest"
            expected = f"those with the digest {digest}, as in the tree"
            raise StageError(self._where, found, expected)
        self.is_packed = name == tokens.PACKED_TYPE
        self.count = len(self._array(tokens.POSITIONS, np.float32, (3,)))

    def close(self) -> None:
        """Release the layer, so that USD reads the file anew if it changes."""
        self._layer = None

    def rows(self, first: int, count: int | None) -> slice:
        """Return these rows as a slice.

        Raises:
            StageError: If the field does not have them.
        """
        last = self.count if count is None else first + count
        if not 0 <= first <= last <= self.count:
            raise StageError(self._where, f"{self.count} splats", f"rows {first} to {last}")
        return slice(first, last)

    def _stated_digest(self) -> str:
        """Return the digest in the layer; "" if it states none."""
        ours = self._layer.customLayerData.get(_OURS)
        digest = ours.get(_DIGEST) if isinstance(ours, dict) else None
        return digest if isinstance(digest, str) else ""

    def digest(self) -> str:
        """Return the digest of the splats: the beginning of a SHA-256 over the degree and the
        names, types and values of all arrays of numbers."""
        found = hashlib.sha256(f"{self.degree()}".encode())
        packed = (tokens.POSITIONS, *tokens.PACKED_ARRAYS)
        for name in packed if self.is_packed else tokens.HALF_OF:
            array = np.asarray(self._value(name))
            found.update(f"\0{name} {array.dtype} {array.shape}\0".encode())
            if array.dtype.kind in "fiu":
                found.update(np.ascontiguousarray(array).data)
        return found.hexdigest()[:_DIGITS]

    def cloud(self, rows: slice) -> SplatCloud:
        """Return rows of the field, decoded.

        Raises:
            StageError: As for `packed` and `stock`.
        """
        if self.is_packed:
            packed = self.packed(rows)
            return packing.unpack(packed.positions, packed.arrays)
        return self.stock(rows)

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


def state_digest(layer: Sdf.Layer) -> str:
    """Write the digest of the splats of a chunk into its layer, and return it.

    Raises:
        StageError: If the layer has no field as its default prim.
    """
    field = ChunkField(layer, layer.identifier)
    field.check("")
    digest = field.digest()
    layer.customLayerData = {**layer.customLayerData, _OURS: {_DIGEST: digest}}
    return digest


@contextmanager
def opened_layer(path: str, digest: str = "") -> Iterator[ChunkField]:
    """Open the field of a chunk, which must state the digest unless that is "".

    Raises:
        StageError: If it cannot be read; instead of USD's own errors, too.
    """
    if not path:
        raise StageError("chunk", "no file", "a layer with splats")
    file = Path(Ar.SplitPackageRelativePathOuter(path)[0])
    if file.exists() and not file.is_file():  # opening a pipe would wait for ever
        raise StageError(path, "no regular file", "a layer with splats")
    check_arrays(path, is_chunk=True)
    field = None
    try:
        layer = Sdf.Layer.FindOrOpen(readable(path))
        if not layer:
            raise StageError(path, "nothing that USD can read", "a layer with splats")
        field = ChunkField(layer, path)
        del layer
        field.check(digest)
        yield field
    except Tf.ErrorException as error:
        raise StageError(path, sentence(error), "a layer with splats") from None
    finally:
        if field is not None:
            field.close()
