"""Merge the deep samples of all pictures that a picture averages into one deep picture.

The result flattens to the average of the pictures, and so does any part of it in front of a depth:
`kernels.deep_merge` says why. Contributions of the same depth (and ids, if they are requested) are
joined. The centre of a splat that does not move has the same depth through every point of lens and
pixel, so such a splat remains one sample.

The number of contributions that are held at a time is limited. Where they do not fit, fewer rows
are merged at a time, then fewer columns. The result does not depend on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.errors import UsageError
from usdsplat.kernels import deep_merge
from usdsplat.kernels.bins import TILE
from usdsplat.kernels.device import Device
from usdsplat.render import sampling
from usdsplat.render.deep_samples import DeepSamples
from usdsplat.render.frame import DEEP_PIXELS, bin_band, deep_samples, fetched_surfaces, prepare
from usdsplat.render.frame_context import FrameContext
from usdsplat.render.lod.nodes import samples_of
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec

HELD = 128
"""Contributions of a pixel that are held at a time, on average over a strip. It is twice the usual
number, because those of several pictures are held before they are joined."""
ENTRIES = HELD * DEEP_PIXELS
"""Default maximum number of contributions that are held. A region that needs more is divided."""
ROOM = 4
"""A region becomes larger again where less than this part of the maximum is held."""

Window = tuple[int, int, int, int]
"""Pixels x0, y0, x1, y1, end exclusive."""


def merges_deep(settings: RenderSettings, ids: int) -> bool:
    """Return whether the samples of a deep picture with a number of ids are merged on the host."""
    return settings.samples > 1 or (ids > 0 and settings.deep_error > 0)


class TooManyEntries(Exception):
    """More contributions of a region than may be held at a time. Cure: a smaller region."""


@dataclass(frozen=True, slots=True, eq=False)
class _Entries:
    """Contributions to the pixels of a region, see `kernels.deep_merge`."""

    offsets: I64
    """First entry of each pixel and, last, their number."""
    depth: F32
    weights: F32
    paints: F32
    ids: I32

    @property
    def arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.offsets, self.depth, self.weights, self.paints, self.ids


class DeepAccumulator:
    """Average of deep pictures.

    Args:
        device: Device whose host threads merge.
        count: Number of pictures.
        most: Maximum number of contributions that are held.
    """

    def __init__(self, device: Device, count: int, most: int) -> None:
        self._device, self._count, self._most = device, count, most
        self._lists: list[tuple[int, _Entries]] = []
        """Entries of 2^level consecutive pictures, with the level, which decreases. Lists of equal
        level are joined, so the time of n pictures grows with n log n. The order of sums follows
        from the pictures' numbers alone, so rounding depends on nothing else."""
        self.held = 0
        """Largest number of contributions so far."""
        self._prims: dict[str, int] = {}
        """Path -> number of each prim, in the order of first appearance."""
        self._id_names: tuple[str, ...] = ()
        self._shape = (0, 0)

    def add(self, samples: DeepSamples) -> None:
        """Add one picture.

        Raises:
            TooManyEntries: If more contributions than `most` remain.
        """
        self._shape, self._id_names = samples.counts.shape, samples.id_names
        offsets = _offsets(samples.counts)
        weights = np.empty(len(samples.depth), np.float32)
        paints = np.empty((len(weights), 3), np.float32)
        self._device.run(deep_merge.weigh, offsets, samples.color, 1 / self._count, weights, paints)
        # The depths are copied because they share their memory with colours.
        depth, ids = samples.depth.copy(), self._renumbered(samples)
        entries, level = _Entries(offsets, depth, weights, paints, ids), 0
        while self._lists and self._lists[-1][0] == level:
            entries = self._joined(self._lists.pop()[1], entries)
            level += 1
        self._lists.append((level, entries))
        held = sum(len(each.depth) for _, each in self._lists)
        self.held = max(self.held, held)
        if held > self._most:
            raise TooManyEntries

    def finish(self, error: float) -> DeepSamples:
        """Return the merged samples, once. For `error` see `RenderSettings.deep_error`."""
        run, error = self._device.run, float(error)
        _, entries = self._lists.pop()
        while self._lists:
            entries = self._joined(self._lists.pop()[1], entries)
        k, places = entries.ids.shape[1], np.empty(len(entries.offsets) - 1, np.int64)
        nothing = np.empty(0, np.float32)
        none = nothing, nothing, np.empty((0, 4), np.float32), np.empty((0, k), np.int32)
        run(deep_merge.merge, entries.arrays, error, False, places, none)
        counts = places.astype(np.uint32).reshape(self._shape)
        offsets = _offsets(counts)
        n = int(offsets[-1])
        near = np.empty(n, np.float32)
        far = near if error == 0 else np.empty(n, np.float32)
        color, ids = np.empty((n, 4), np.float32), np.empty((n, k), np.int32)
        out = near, far, color, ids
        run(deep_merge.merge, entries.arrays, error, True, offsets[:-1].copy(), out)
        left = np.broadcast_to(np.float32(1), self._shape)
        prims = tuple(self._prims)
        return DeepSamples(counts, near, far, color, left, ids, self._id_names, prims)

    # --- private ---------------------------------------------------------------------------

    def _renumbered(self, samples: DeepSamples) -> I32:
        """Return the ids of a picture, with the prims' numbers in all pictures."""
        ids = samples.ids.copy()
        if "primId" in samples.id_names:
            known = self._prims
            table = [known.setdefault(path, len(known)) for path in samples.prims]
            column = samples.id_names.index("primId")
            ids[:, column] = np.array(table, np.int32)[ids[:, column]]
        return ids

    def _joined(self, first: _Entries, last: _Entries) -> _Entries:
        """Return two lists as one."""
        run, k = self._device.run, first.ids.shape[1]
        places, nothing = np.empty(len(first.offsets) - 1, np.int64), np.empty(0, np.float32)
        none = nothing, nothing, np.empty((0, 3), np.float32), np.empty((0, k), np.int32)
        run(deep_merge.join, first.arrays, last.arrays, False, places, none)
        offsets = _offsets(places)
        n = int(offsets[-1])
        out = (
            np.empty(n, np.float32),
            np.empty(n, np.float32),
            np.empty((n, 3), np.float32),
            np.empty((n, k), np.int32),
        )
        run(deep_merge.join, first.arrays, last.arrays, True, offsets[:-1].copy(), out)
        return _Entries(offsets, *out)


class _Regions:
    """Size of the regions that are merged at a time. It follows the number of contributions.

    Args:
        rows, columns: Size of the largest region.
        most: Maximum number of contributions that are held.
    """

    def __init__(self, rows: int, columns: int, most: int) -> None:
        self._tallest, self._widest, self.most = rows, columns, most
        self._rows, self.columns = rows, columns

    def end_of(self, y0: int, end: int) -> int:
        """Return the end of the strip that begins at row `y0`: whole tiles, as in
        `Screen.bands`, while there are several."""
        unit = min(self._rows, TILE)
        return min(end, (y0 + self._rows) // unit * unit)

    def shrink(self, rows: int, columns: int) -> None:
        """Divide regions after one of this size, of several pixels, had too many contributions."""
        if rows > 1:
            self._rows = _half(rows)
        else:
            self._rows, self.columns = 1, (columns + 1) // 2

    def grow(self, held: int, rows: int) -> None:
        """Enlarge regions if a strip of so many rows had few contributions in all its regions."""
        if rows < self._rows or ROOM * held > self.most:
            return
        if self.columns < self._widest:
            self.columns = min(2 * self.columns, self._widest)
        elif self._rows < self._tallest:
            twice = 2 * self._rows
            self._rows = min(twice // TILE * TILE or twice, self._tallest)


def render_merged_deep(
    frame: FrameContext, camera: CameraSpec, screen: Screen, band_pixels: int, most: int = ENTRIES
) -> Iterator[tuple[int, int, DeepSamples]]:
    """Return the merged samples of each pixel, in strips of rows: (y0, y1, samples).

    For ids see `frame.render_deep`.

    Args:
        most: Maximum number of contributions that are held, and of samples of a row of pixels.

    Raises:
        UsageError: If a pixel has more contributions, or a row more samples.
    """
    x0, y0, x1, end = screen.window
    rows = max(1, min(band_pixels, DEEP_PIXELS) // (x1 - x0) // TILE) * TILE
    regions = _Regions(rows, x1 - x0, most)
    while y0 < end:
        y1 = regions.end_of(y0, end)
        draw = _row_by_columns if regions.columns < x1 - x0 else merged_region
        try:
            samples, held = draw(frame, camera, (x0, y0, x1, y1), regions)
        except TooManyEntries:
            continue
        yield y0, y1, samples
        regions.grow(held, y1 - y0)
        y0 = y1


def merged_region(
    frame: FrameContext, camera: CameraSpec, window: Window, regions: _Regions
) -> tuple[DeepSamples, int]:
    """Return the merged samples of some pixels, and how many contributions were held.

    Args:
        window: The pixels.

    Raises:
        TooManyEntries: If there are too many contributions. The next regions are smaller.
        UsageError: If one pixel has too many.
    """
    x0, y0, x1, y1 = window
    plan = sampling.samples(frame.settings, camera)
    plan = tuple(each[0] for each in samples_of(frame.settings, plan, frame.nodes, 1))
    merged = DeepAccumulator(frame.device, len(plan), regions.most)
    try:
        for each in plan:
            sample = prepare(frame, each, window, ())
            tiles, _, surfaces = bin_band(frame, sample, (y0, y1))
            behind = None if surfaces is None else fetched_surfaces(frame, surfaces)
            merged.add(deep_samples(frame, camera, tiles, behind, 0.0))
            frame.clock.lap("merge")
    except TooManyEntries:
        if (x1 - x0, y1 - y0) == (1, 1):
            found = f"more than {regions.most:,} contributions to the pixel {x0}, {y0}"
            expected = "fewer --samples, or a larger --memory-limit"
            raise UsageError("--deep", found, expected) from None
        regions.shrink(y1 - y0, x1 - x0)
        raise
    finally:  # samples move the scene in time; return to the frame, also after an error
        frame.sampler(0.0)
    samples = merged.finish(frame.settings.deep_error)
    frame.clock.lap("merge")
    return samples, merged.held


def _row_by_columns(
    frame: FrameContext, camera: CameraSpec, window: Window, regions: _Regions
) -> tuple[DeepSamples, int]:
    """Return the merged samples of one row of pixels, merged in parts, and the largest number of
    contributions that were held."""
    x0, y0, x1, y1 = window
    parts: list[DeepSamples] = []
    most, count = 0, 0
    while x0 < x1:
        end = min(x1, x0 + regions.columns)
        try:
            part, held = merged_region(frame, camera, (x0, y0, end, y1), regions)
        except TooManyEntries:
            continue
        most, count = max(most, held), count + len(part.depth)
        if count > regions.most:
            found = f"more than {regions.most:,} samples in the row of pixels {y0}"
            expected = "a larger --deep-error or --memory-limit, or fewer --samples"
            raise UsageError("--deep", found, expected)
        parts.append(part)
        x0 = end
    return _beside(parts), most


def _beside(parts: list[DeepSamples]) -> DeepSamples:
    """Return the samples of neighbouring regions of one row of pixels as one."""
    prims = tuple(dict.fromkeys(path for part in parts for path in part.prims))
    number = {path: i for i, path in enumerate(prims)}
    for part in parts:
        if "primId" in part.id_names:
            column = part.id_names.index("primId")
            table = np.array([number[path] for path in part.prims], np.int32)
            part.ids[:, column] = table[part.ids[:, column]]

    def joined(name: str, axis: int = 0) -> npt.NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts], axis=axis)

    return replace(
        parts[0],
        counts=joined("counts", 1),
        depth=joined("depth"),
        depth_back=joined("depth_back"),
        color=joined("color"),
        left=joined("left", 1),
        ids=joined("ids"),
        prims=prims,
    )


def _half(rows: int) -> int:
    """Return about half of a number of rows, at least 1; whole tiles while there are several."""
    return rows // 2 // TILE * TILE if rows >= 2 * TILE else max(1, rows // 2)


def _offsets(counts: npt.NDArray[Any]) -> I64:
    """Return the number of entries before each pixel and, last, of all pixels."""
    offsets = np.zeros(counts.size + 1, np.int64)
    np.cumsum(counts.ravel(), out=offsets[1:])
    return offsets
