"""Read pictures of other renderers as holdouts, which hide splats behind them.

A flat picture has one depth per pixel, at which one minus its A passes: pixels at antialiased edges
hide in part. A deep one has any number of samples, which attenuate within their extents.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError, UsageError
from usdsplat.core.readable import readable
from usdsplat.images import holdout_nodes
from usdsplat.images.deep_reader import DeepFile
from usdsplat.images.holdout_nodes import HoldoutNodes, nodes_of

DEPTHS = ("Z", "depth.Z", "depth")
"""Channels of planar camera depth, in order of preference."""

STRIP = 256
"""Number of rows read at a time when a file is searched; a multiple of usual tile sizes."""


class Holdout(ABC):
    """A picture with depth, created by `open_holdout`."""

    nodes: float = 0.0
    """Mean number of nodes in a pixel of the fullest rows of a deep file; 0 for a flat one."""
    without_depth: int = 0
    """Number of pixels of a flat picture with A above 0 that have no finite depth above 0. They
    hide nothing."""

    @abstractmethod
    def rows(
        self, x0: int, y0: int, x1: int, y1: int
    ) -> F32 | HoldoutNodes | tuple[F32, HoldoutNodes]:
        """Read the holdout in a window of the display window's pixels, ends exclusive.

        Returns:
            For a flat picture planar camera depth, shape (y1 - y0, x1 - x0), inf in pixels that do
            not hide everything; for a deep one the nodes of its samples, pixels row-major. For a
            flat picture with pixels that hide in part, both. Pixels outside the file are empty.

        Raises:
            FormatError: If the file is damaged.
        """


def open_holdout(path: Path | str, *, resolution: tuple[int, int]) -> Holdout:
    """Open a picture as a holdout: its first part that is deep or has depth.

    In a flat picture the channel is Z, depth.Z or depth, or that of another layer ("x.Z"). If the
    same part has A, a pixel lets 1 - A through; depths that are not above 0 are ignored.
    A deep sample with a ZBack attenuates within its extent, see `holdout_nodes`. Nothing at or
    behind the camera hides anything: of a deep sample that begins there, the part in front does.

    Args:
        path: An EXR file.
        resolution: Display window of the rendered picture [pixel]; the file must have the same.

    Raises:
        UsageError: If the file does not exist, or has another display window.
        FormatError: If it has no depth, or is not a picture.
    """
    where = str(path)
    if not Path(path).is_file():
        raise UsageError(where, "no such file", "an EXR with depth")
    file = oiio.ImageInput.open(readable(where))
    if file is None:
        found = oiio.geterror().replace(where, Path(path).name).strip().rstrip(".")
        raise FormatError(where, found or "no picture", "an EXR with depth")
    try:
        channels: list[str] = []
        part = 0
        while file.seek_subimage(part, 0):
            spec = file.spec()
            depth = _depth_channel(spec.channelnames)
            if spec.deep or depth is not None:
                _check_display(where, spec, resolution)
                return _Deep(where) if spec.deep else _Flat(where, part, spec, str(depth))
            channels += spec.channelnames
            part += 1
        # OpenImageIO prints unread errors at exit, here that there are no more parts.
        file.geterror()
    finally:
        file.close()
    raise FormatError(where, f"channels {', '.join(channels)}", f"one of {', '.join(DEPTHS)}")


def _depth_channel(names: tuple[str, ...]) -> str | None:
    """Return the depth channel, or None."""
    layers = [name for name in names if name.endswith(".Z")]
    return next((name for name in (*DEPTHS, *layers) if name in names), None)


def _check_display(where: str, spec: oiio.ImageSpec, resolution: tuple[int, int]) -> None:
    found = spec.full_x, spec.full_y, spec.full_width, spec.full_height
    if found != (0, 0, *resolution):
        x, y, width, height = found
        raise UsageError(
            where,
            f"a display window of {width}x{height} at {x}, {y}",
            f"{resolution[0]}x{resolution[1]} at 0, 0, as the picture has",
        )


class _Flat(Holdout):
    """A flat holdout: one depth for each pixel, and the part of the light that passes."""

    def __init__(self, where: str, part: int, spec: oiio.ImageSpec, depth: str) -> None:
        self._where = where
        self._part = part
        self._spec = spec
        names = spec.channelnames
        self._depth = names.index(depth)
        self._alpha = names.index("A") if "A" in names else None
        self._hides_in_part = False
        if self._alpha is not None:
            self._search()

    def rows(self, x0: int, y0: int, x1: int, y1: int) -> F32 | tuple[F32, HoldoutNodes]:
        depth = np.full((y1 - y0, x1 - x0), np.inf, np.float32)
        alpha = np.ones_like(depth)
        spec = self._spec
        left, top = max(x0, spec.x), max(y0, spec.y)
        right, bottom = min(x1, spec.x + spec.width), min(y1, spec.y + spec.height)
        if left < right and top < bottom:
            columns = slice(left - spec.x, right - spec.x)
            inside = slice(top - y0, bottom - y0), slice(left - x0, right - x0)
            for plane, values in zip((depth, alpha), self._planes(top, bottom), strict=True):
                plane[inside] = values[:, columns]
        if not self._hides_in_part:
            return depth
        # Also for rows without such pixels, so that no pixel depends on the rows that are read with
        # it.
        is_edge = (np.isfinite(depth) & (alpha < 1)).ravel()
        offsets = np.zeros(depth.size + 1, np.int64)
        np.cumsum(is_edge, out=offsets[1:])
        edges = offsets, depth.ravel()[is_edge], 1 - alpha.ravel()[is_edge]
        return np.where(alpha < 1, np.float32(np.inf), depth), edges

    def _search(self) -> None:
        """Find out whether a pixel lets a part of the light through, and which lack a depth."""
        spec = self._spec
        for top in range(spec.y, spec.y + spec.height, STRIP):
            bottom = min(top + STRIP, spec.y + spec.height)
            depth, alpha = self._planes(top, bottom)
            is_there = np.isfinite(depth)
            self._hides_in_part |= bool((is_there & (alpha < 1)).any())
            self.without_depth += int(np.count_nonzero((alpha > 0) & ~is_there))

    def _planes(self, top: int, bottom: int) -> tuple[F32, F32]:
        """Read depth, inf where nothing hides, and opacity of whole rows."""
        file = oiio.ImageInput.open(readable(self._where))
        if file is None:
            raise FormatError(
                self._where, oiio.geterror(), "the file that was readable when rendering began"
            )
        try:
            depth = self._channel(file, self._depth, top, bottom)
            alpha = np.ones_like(depth)
            if self._alpha is not None:
                alpha = np.minimum(self._channel(file, self._alpha, top, bottom), 1)
            is_there = (depth > 0) & (alpha > 0)
        finally:
            file.close()
        return np.where(is_there, depth, np.float32(np.inf)), alpha

    def _channel(self, file: oiio.ImageInput, index: int, y0: int, y1: int) -> F32:
        """Read whole rows of one channel."""
        spec, part, channels = self._spec, self._part, (index, index + 1)
        if spec.tile_height == 0:
            pixels = file.read_scanlines(part, 0, y0, y1, 0, *channels, "float")
            return self._checked(file, pixels)
        # Tiles are read completely: all rows of tiles that contain the requested rows.
        first = y0 - (y0 - spec.y) % spec.tile_height
        last = min(y1 + (spec.y - y1) % spec.tile_height, spec.y + spec.height)
        right = spec.x + spec.width
        window = spec.x, right, first, last, 0, 1
        pixels = file.read_tiles(part, 0, *window, *channels, "float")
        return self._checked(file, pixels)[y0 - first : y1 - first]

    def _checked(self, file: oiio.ImageInput, pixels: npt.NDArray[np.float32] | None) -> F32:
        if pixels is None:
            found = file.geterror().replace(self._where, Path(self._where).name).strip()
            raise FormatError(self._where, found.rstrip("."), "a complete EXR file")
        return pixels.reshape(-1, self._spec.width)


class _Deep(Holdout):
    """A deep holdout: any number of samples for each pixel."""

    def __init__(self, where: str) -> None:
        self._where = where
        with DeepFile(where) as file:
            self._window = file.window
            x0, y0, x1, y1 = file.window
            pixels = (x1 - x0) * min(file.band_rows, y1 - y0)
            self.nodes = 2 * max(file.samples_by_band()) / pixels

    def rows(self, x0: int, y0: int, x1: int, y1: int) -> HoldoutNodes:
        tops = range(y0, y1, holdout_nodes.STRIP)
        strips = [self._nodes(x0, y, x1, min(y + holdout_nodes.STRIP, y1)) for y in tops]
        counts = np.concatenate([np.diff(offsets) for offsets, _, _ in strips])
        offsets = np.zeros(len(counts) + 1, np.int64)
        np.cumsum(counts, out=offsets[1:])
        depth, through = (np.concatenate([strip[k] for strip in strips]) for k in (1, 2))
        return offsets, depth, through

    def _nodes(self, x0: int, y0: int, x1: int, y1: int) -> HoldoutNodes:
        left, top, right, bottom = self._window
        counts = np.zeros((y1 - y0, x1 - x0), np.int64)
        first, last = max(y0, top), min(y1, bottom)
        begin, end = max(x0, left), min(x1, right)
        front = back = alpha = np.zeros(0, np.float32)
        if first < last and begin < end:
            with DeepFile(self._where) as file:
                names = "Z", "ZBack", "A"
                offsets, values = file.rows(first, last, names, columns=(begin, end))
            there = counts[first - y0 : last - y0, begin - x0 : end - x0]
            there[:] = np.diff(offsets).reshape(there.shape)
            front, alpha = values["Z"], values["A"]
            back = values.get("ZBack", front)
        starts = np.zeros(counts.size + 1, np.int64)
        np.cumsum(counts, out=starts[1:])
        return nodes_of(starts, *_in_front(front, back, alpha))


def _in_front(front: F32, back: F32, alpha: F32) -> tuple[F32, F32, F32]:
    """Return the parts of deep samples in front of the camera: split at depth 0 by OpenEXR's rule.
    Samples without such a part get an opacity of 0."""
    starts_behind = np.isfinite(front) & (front <= 0)
    if not starts_behind.any():
        return front, back, alpha
    reaches = starts_behind & np.isfinite(back) & (back > 0)
    front, alpha = front.copy(), alpha.copy()
    alpha[starts_behind & ~reaches] = 0
    near, far = front[reaches].astype(np.float64), back[reaches].astype(np.float64)
    with np.errstate(divide="ignore"):  # an opaque sample remains opaque
        density = np.log1p(-np.clip(alpha[reaches], 0, 1).astype(np.float64))
    alpha[reaches] = -np.expm1(density * (far / (far - near)))
    front[reaches] = 0
    return front, back, alpha
