"""The splats of one band: lists of its tiles, and whatever is read off them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.errors import UsageError
from usdsplat.delegate.frame_stats import FrameStats
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.visible import Visible
from usdsplat.kernels import bins, blend, deep, feature, median, project, walk
from usdsplat.kernels.device import Device

Holdout = tuple[I64, F32, F32]
"""A deep holdout as `walk` takes it."""
NO_HOLDOUT: Holdout = (np.empty(0, np.int64), np.empty(0, np.float32), np.empty(0, np.float32))
for _each in NO_HOLDOUT:
    _each.flags.writeable = False  # as those are that a device keeps: kernels are compiled once
NO_STOPS = np.empty((0, 0), np.float32)
NO_COVER = np.empty((0, 0), np.uint8)
NO_DEEP = (np.empty(0, np.float32), np.empty(0, np.float32), np.empty((0, 4), np.float32))


@dataclass(frozen=True, slots=True, eq=False)
class Behind:
    """What is behind, or between, the splats of a band."""

    stops: F32 = field(default_factory=lambda: NO_STOPS)
    """Planar depth of surfaces, +inf where there is none, shape (h, w); of no size without any."""
    covered: npt.NDArray[np.uint8] = field(default_factory=lambda: NO_COVER)
    """What they are, see `kernels.surface`, shape (h, w); of no size without any."""
    holdout: Holdout = NO_HOLDOUT


@dataclass(frozen=True, slots=True, eq=False)
class DeepSamples:
    """What the pixels of a band hold, near to far, pixel after pixel."""

    counts: npt.NDArray[np.uint32]
    """Shape (h, w)."""
    depth: F32
    """Nearest of each sample, shape (n,)."""
    depth_back: F32
    """Farthest, shape (n,)."""
    color: F32
    """Premultiplied RGBA of each by itself, shape (n, 4)."""

    left: F32
    """How much of a surface behind the samples of a pixel is there: 1 but where something else
    holds out, shape (h, w)."""

    def with_surfaces(self, stops: F32, drawn: npt.NDArray[np.bool_], colors: F32) -> DeepSamples:
        """Return these and, behind those of each pixel where a surface is drawn, one of it.

        Args:
            stops: Its depth, shape (h, w); colors: linear RGB, shape (h, w, 3).
        """
        ends = np.cumsum(self.counts, dtype=np.int64)
        more = np.cumsum(drawn.ravel(), dtype=np.int64)
        places = ends[drawn.ravel()] + more[drawn.ravel()] - 1
        kept = np.ones(len(self.depth) + int(more[-1]), bool)
        kept[places] = False

        def merged(samples: F32, surfaces: F32) -> F32:
            out = np.empty((len(kept), *samples.shape[1:]), np.float32)
            out[kept], out[places] = samples, surfaces
            return out

        left = self.left[drawn][:, None]
        return DeepSamples(
            counts=self.counts + drawn.astype(np.uint32),
            depth=merged(self.depth, stops[drawn]),
            depth_back=merged(self.depth_back, stops[drawn]),
            color=merged(self.color, np.concatenate([colors[drawn] * left, left], axis=1)),
            left=self.left,
        )


class Layer:
    """One band of what a view sees."""

    def __init__(
        self,
        device: Device,
        scratch: Scratch,
        seen: Visible,
        window: tuple[int, int, int, int],
        *,
        by_ray: bool,
        behind: Behind,
        stats: FrameStats,
    ) -> None:
        x0, y0, x1, y1 = window
        self.shape = (y1 - y0, x1 - x0)
        self._device = device
        self._scratch = scratch
        self._seen = seen
        self._by_ray = by_ray
        self._behind = behind
        self._stats = stats
        self._walks = by_ray or seen.keeps.size > 0 or behind.holdout[0].size > 0
        """Whether contributions must be taken one by one."""
        self._grid = bins.grid_of(x0, y0, x1, y1)
        key = seen.stamp, window
        noted = scratch.noted("tile lists")
        if noted is None or noted[0] != key:
            made = device.run(
                bins.tile_lists, seen.records, self._grid, bins.tiles_in(self._grid),
                4 * device.threads, scratch.get,
            )  # fmt: skip
            noted = key, made
            scratch.note("tile lists", noted)
        self._starts, self._lists, pairs = noted[1]
        if pairs > bins.MOST_PAIRS:
            raise UsageError("band", f"{pairs} pairs of splat and tile", "less than 2**31")
        self._stats.pairs += pairs

    # --- what is read off ------------------------------------------------------------------

    def color(self) -> tuple[F32, F32 | None]:
        """Premultiplied RGBA in the blend space, shape (h, w, 4), and the transmittance, shape
        (h, w), where it is not just what is missing from A."""
        self._color, self._through = self._paint("color", self._seen.records, project.RED)
        return self._color, self._through

    def paint(self, name: str, column: int) -> F32:
        """Sums of three features over all contributions, and coverage, shape (h, w, 4)."""
        return self._paint(name, self._seen.features, column)[0]

    def depths(self) -> F32:
        """Sums of the depths of all contributions, two unused, and coverage, shape (h, w, 4)."""
        if self._walks:
            return self._paint("depths", self._seen.features, walk.DEPTHS)[0]
        return self.paint("depths", feature.EXPECTED)

    def median(self, name: str, part: float) -> tuple[F32, I32]:
        """Depth and ids, shapes (h, w) and (4, h, w), of the splats in which a part of the
        coverage is passed; `color` comes first."""
        run, get, seen = self._device.run, self._scratch.get, self._seen
        keep = self._device.keep
        ranks = get(f"{name} ranks", self.shape, np.int32)
        depth = get(f"{name} depth", self.shape, np.float32)
        ids = get(f"{name} ids", (4, *self.shape), np.int32)
        if self._walks:
            peaks = get(f"{name} peaks", self.shape, np.float32)
            self._walk(
                walk.MEDIAN, part=part, image=self._color, through=self._through, ranks=ranks,
                depths=peaks,
            )  # fmt: skip
        else:
            run(
                median.median, seen.records, self._starts, self._lists, self._grid, seen.peaks,
                self._behind.stops, seen.is_parallel, self._color, self._behind.covered,
                np.float32(part), ranks,
            )  # fmt: skip
        run(
            median.resolve, ranks, seen.records, seen.order, seen.sources,
            keep(seen.layout.first_slots), keep(seen.layout.labels), depth, ids,
        )  # fmt: skip
        if self._walks:
            run(median.hold_depth, ranks, peaks, NO_STOPS, depth)
        elif self._behind.stops.size > 0:
            run(median.hold_depth, ranks, NO_STOPS, self._behind.stops, depth)
        return depth, ids

    def weigh(self) -> tuple[I32, F32]:
        """Prims that contribute most and by how much, shapes (h, w, walk.RANKS)."""
        ids = self._scratch.get("prims", (*self.shape, walk.RANKS), np.int32)
        weights = self._scratch.get("weights", (*self.shape, walk.RANKS), np.float32)
        self._walk(walk.WEIGH, ids=ids, weights=weights)
        return ids, weights

    def deep(self, error: float) -> DeepSamples:
        """Every contribution, or runs of them; `Visible` must be in a linear blend space."""
        resident, fetch = self._device.resident, self._device.fetch
        held = resident(self.shape, np.uint32)
        walks = self._walks or self._behind.stops.size > 0
        if walks:
            self._walk(walk.COUNT, error=error, counts=held)
        else:
            self._deep(error, False, np.empty(0, np.int64), held, NO_DEEP)
        offsets = self._scratch.get("deep offsets", (held.size + 1,), np.int64)
        total = int(self._device.run(deep.place, held, offsets))
        near, color = resident((total,), np.float32), resident((total, 4), np.float32)
        far = near if error == 0 else resident((total,), np.float32)
        left = np.broadcast_to(np.float32(1), self.shape)
        if walks:
            left = left.copy()
            self._walk(
                walk.FILL, error=error, offsets=offsets, through=left, deep=(near, far, color)
            )
        else:
            self._deep(error, True, offsets, held, (near, far, color))
        depth = fetch(near)
        back = depth if far is near else fetch(far)
        return DeepSamples(fetch(held), depth, back, fetch(color), left)

    # --- private ---------------------------------------------------------------------------

    def _paint(self, name: str, paints: F32, column: int) -> tuple[F32, F32 | None]:
        run, get, seen = self._device.run, self._scratch.get, self._seen
        image = get(name, (*self.shape, 4), np.float32)
        if self._walks:
            through = get(f"{name} through", self.shape, np.float32)
            self._walk(walk.PAINT, paints=paints, column=column, image=image, through=through)
            return image, through
        work = get("work", (self._starts.shape[0] - 1,), np.int64)
        height, width = self.shape
        run(
            blend.blend, seen.records, paints, column, self._starts, self._lists, self._grid,
            seen.peaks, self._behind.stops, seen.is_parallel, image.reshape((height, 4 * width)),
            work,
        )  # fmt: skip
        if isinstance(work, np.ndarray):  # a GPU does not count
            self._stats.rows += int(work.sum())
        return image, None

    def _deep(
        self,
        error: float,
        writes: bool,
        offsets: I64,
        counts: npt.NDArray[np.uint32],
        samples: tuple[F32, F32, F32],
    ) -> None:
        """Count samples, or write them."""
        self._device.run(
            deep.deep, self._seen.records, self._starts, self._lists, self._grid, project.RED,
            np.float32(error), writes, offsets, counts, *samples,
        )  # fmt: skip

    def _walk(
        self,
        mode: int,
        *,
        paints: F32 | None = None,
        column: int = project.RED,
        part: float = 0.0,
        error: float = 0.0,
        **out: Any,
    ) -> None:
        """Walk all pixels; `out` names what the mode reads and writes."""
        seen = self._seen
        options = np.zeros(1, walk.WALK)
        options["mode"], options["column"] = mode, column
        options["by_ray"], options["is_parallel"] = self._by_ray, seen.is_parallel
        options["prims"], options["part"], options["error"] = len(seen.layout.prims), part, error
        options["near"] = seen.near
        nothing = {
            "image": np.empty((0, 0, 4), np.float32),
            "through": NO_STOPS,
            "ranks": np.empty((0, 0), np.int32),
            "depths": NO_STOPS,
            "ids": np.empty((0, 0, walk.RANKS), np.int32),
            "weights": np.empty((0, 0, walk.RANKS), np.float32),
            "counts": np.empty((0, 0), np.uint32),
            "offsets": np.empty(0, np.int64),
            "deep": NO_DEEP,
        }
        self._device.run(
            walk.walk, options, seen.records, seen.records if paints is None else paints,
            seen.keeps, seen.labels, self._starts, self._lists, self._grid, seen.peaks,
            self._behind.stops, self._behind.covered, self._behind.holdout,
            tuple((nothing | out).values()),
        )  # fmt: skip
