"""Write deep EXR files band by band.

A file has one scanline part with channels R G B A Z, ZBack if samples may be merged, and those of
ids and Cryptomattes, see `deep_aovs`. Each row is compressed separately and written at once, so
memory holds one band.

This module writes the bytes itself, because that is the fastest way by far (`benchmarks/deep.py`):
1920x1080 with 15 samples a pixel on two busy cores take 1 s uncompressed and 8 s with zips. The
OpenEXR wheel takes 17 s uncompressed and needs an object for each pixel of the whole picture.
OpenImageIO's DeepData, which is filled value by value, takes 45 s. Zips reduces the size of splat
samples by only a third.

Source: OpenEXR's "File Layout" and "Interpreting OpenEXR Deep Pixels".
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import usdsplat
from usdsplat.core.cloud import F32
from usdsplat.core.encoding import HALF_MAX
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.output import output_file
from usdsplat.images import thread_count
from usdsplat.images.color import color_space
from usdsplat.images.compression import Compression
from usdsplat.images.deep_aovs import deep_channels, id_channels, meanings
from usdsplat.images.exr_bytes import (
    DEEP,
    NONE,
    ZIPS,
    Attributes,
    box,
    channel_list,
    encoded,
    header,
    zipped,
)
from usdsplat.images.layout import Entry, ImageLayout
from usdsplat.images.whole_exr import is_whole_exr
from usdsplat.images.writer import ROWS

CODES_OF = {"none": NONE, "zips": ZIPS}
MERGED_MEANINGS = {"usdsplat:aov:ZBack": "planar camera depth at which a merged sample ends"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DeepBand:
    """Whole rows of a deep picture; samples are ordered by row, pixel, then near to far."""

    counts: npt.NDArray[np.uint32]
    """Number of samples of each pixel, shape (rows, width)."""
    depth: F32
    """Planar camera depth [scene unit], shape (n,)."""
    depth_back: F32
    """Far end of a sample [scene unit], shape (n,); equals `depth` if it is not merged."""
    color: F32
    """Premultiplied linear RGBA, shape (n, 4)."""
    ids: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    """Values of the channels that `deep_aovs.id_channels` names, shape (n,) each."""


class DeepWriter:
    """Writer of a deep EXR: a context manager that takes bands, top to bottom.

    Args:
        path: The file; it appears when the context ends without an error.
        layout: Size, compression (none or zips) and metadata; `pixel_type` half (default) or float
            applies to R, G, B and A. Its `aovs` are of `deep_aovs.DEEP_AOVS`, its colour space must
            be linear.
        merged: Whether samples may have an extent in depth, which adds ZBack.

    Raises:
        UsageError: If a deep EXR cannot have this layout or compression.
        OutputError: If the file cannot be created, on entering the context.
    """

    def __init__(
        self,
        path: Path | str,
        layout: ImageLayout,
        *,
        merged: bool = False,
    ) -> None:
        compression = Compression.parse(layout.compression or "none", where=str(path), deep=True)
        if layout.pixel_type not in (None, "half", "float"):
            raise UsageError(str(path), f"{layout.pixel_type} pixels", "half or float in an EXR")
        if color_space(layout.color_space, where="output color space").gamma != 1.0:
            raise UsageError(str(path), f"deep samples in {layout.color_space}", "a linear space")
        self._path = Path(path)
        self._layout = layout
        self._merged = merged
        self._ids = id_channels(layout.aovs)
        self._compression = compression.name
        self._color = np.dtype("<f4" if layout.pixel_type == "float" else "<f2")
        self._next_row = layout.window[1]
        self._most = 0
        self._chunks: list[int] = []

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            output = stack.enter_context(output_file(self._path, is_whole=is_whole_exr))
            self._file = stack.enter_context(output.open())
            self._pool = stack.enter_context(ThreadPoolExecutor(thread_count()))
            self._put(self._header())
            self._put(bytes(8 * self._layout.shape[0]))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            bottom = self._layout.window[3]
            if self._next_row != bottom:
                raise ValueError(f"{self._path}: found rows to {self._next_row}, expected {bottom}")
            # The chunk table follows the header, which needs the final maximum sample count.
            start = self._header()
            self._seek(0)
            self._put(start)
            self._put(struct.pack(f"<{len(self._chunks)}Q", *self._chunks))
            self._close()

    def write_band(self, y0: int, band: DeepBand) -> None:
        """Append whole rows.

        Args:
            y0: First row [pixel], in display window coordinates; it must follow the last band.
            band: The rows.

        Raises:
            OutputError: If the file cannot be written.
            ValueError: If rows are out of order, arrays do not match each other or the layout, or
                the samples of a pixel are not in order from near to far.
        """
        rows = self._rows_of(y0, band)
        ends = np.cumsum(band.counts.sum(axis=1, dtype=np.int64)).tolist()
        starts = [0, *ends]

        def packed(row: int) -> tuple[bytes, ...]:
            part = slice(starts[row], ends[row])
            return self._packed(y0 + row, band, row, part)

        for first in range(0, rows, ROWS):
            some = range(first, min(first + ROWS, rows))
            for pieces in self._pool.map(packed, some):
                self._chunks.append(self._file.tell())
                for piece in pieces:
                    self._put(piece)
        self._most = max(self._most, int(band.counts.max(initial=0)))
        self._next_row += rows

    def _rows_of(self, y0: int, band: DeepBand) -> int:
        """Check a band and return its number of rows."""
        rows, n = len(band.counts), len(band.depth)
        expected = {
            "counts": f"uint32{(rows, self._layout.shape[1])}",
            "depth": f"float32{(n,)}",
            "depth_back": f"float32{(n,)}",
            "color": f"float32{(n, 4)}",
        }
        expected |= {name: f"{dtype}{(n,)}" for name, dtype in self._ids.items()}
        for name, shape in expected.items():
            array = band.ids.get(name) if name in self._ids else getattr(band, name)
            found = "nothing" if array is None else f"{array.dtype}{array.shape}"
            if found != shape:
                raise ValueError(f"band {y0} {name}: found {found}, expected {shape}")
        total = int(band.counts.sum(dtype=np.int64))
        if total != n:
            raise ValueError(f"band {y0}: found {n} samples, expected {total}")
        if y0 != self._next_row or not 0 < rows <= self._layout.window[3] - y0:
            raise ValueError(f"band: found rows {y0} to {y0 + rows}, expected {self._next_row} on")
        return rows

    def _packed(self, y: int, band: DeepBand, row: int, part: slice) -> tuple[bytes, ...]:
        """Return one row in the file's form: row number and sizes, counts, samples."""
        ends = np.cumsum(band.counts[row], dtype="<i4")
        depth = band.depth[part]
        falls = depth[1:] < depth[:-1]
        starts = ends[(ends > 0) & (ends < len(depth))]
        falls[starts - 1] = False
        if falls.any():
            raise ValueError(f"row {y}: found samples out of order, expected near to far")
        color = band.color[part]
        if self._color.itemsize == 2:
            color = np.clip(color, -HALF_MAX, HALF_MAX)
        # Channels are in alphabetical order: A B G R Z ZBack, then ids, whose names are lower case.
        pieces = [color.T[::-1].astype(self._color, order="C"), depth.astype("<f4", copy=False)]
        if self._merged:
            pieces.append(band.depth_back[part].astype("<f4", copy=False))
        for name, dtype in self._ids.items():
            pieces.append(np.ascontiguousarray(band.ids[name][part], dtype))
        table, samples = ends.tobytes(), b"".join(piece.data for piece in pieces)
        packed_table, packed_samples = table, samples
        if self._compression == "zips":
            packed_table, packed_samples = zipped(table), zipped(samples)
        sizes = len(packed_table), len(packed_samples), len(samples)
        return struct.pack("<iQQQ", y, *sizes), packed_table, packed_samples

    def _header(self) -> bytes:
        layout = self._layout
        channels = deep_channels(layout.aovs, self._color, merged=self._merged)
        space = color_space(layout.color_space)
        labels: dict[str, Entry] = {
            "screenWindowCenter": (0.0, 0.0),
            "screenWindowWidth": 1.0,
            "pixelAspectRatio": float(layout.pixel_aspect_ratio),
            "colorInteropID": "data" if space.chromaticities is None else layout.color_space,
            "Software": f"usdsplat {usdsplat.__version__}",
            **meanings(layout.aovs),
            **(MERGED_MEANINGS if self._merged else {}),
            **layout.metadata,
        }
        if space.chromaticities is not None:
            labels["chromaticities"] = space.chromaticities
        attributes: Attributes = {
            "channels": ("chlist", channel_list(channels)),
            "compression": ("compression", bytes([CODES_OF[self._compression]])),
            "dataWindow": ("box2i", box(layout.window)),
            "displayWindow": ("box2i", box((0, 0, *layout.resolution))),
            "lineOrder": ("lineOrder", b"\0"),
            "name": ("string", b"deep"),
            "type": ("string", b"deepscanline"),
            "version": ("int", struct.pack("<i", 1)),
            "chunkCount": ("int", struct.pack("<i", layout.shape[0])),
            "maxSamplesPerPixel": ("int", struct.pack("<i", self._most)),
        }
        # deepImageState could state that samples are sorted, but OpenEXR's Python package rejects
        # files that have it.
        return header(attributes | encoded(labels), DEEP)

    def _put(self, data: bytes) -> None:
        try:
            self._file.write(data)
        except OSError as error:
            raise self._no_room(error) from error

    def _seek(self, position: int) -> None:
        try:
            self._file.seek(position)
        except OSError as error:
            raise self._no_room(error) from error

    def _close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise self._no_room(error) from error

    def _no_room(self, error: OSError) -> OutputError:
        return OutputError(
            str(self._path), error.strerror or str(error), "a writable place with enough free space"
        )
