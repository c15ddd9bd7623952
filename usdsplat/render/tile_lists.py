"""List the splats of one band by tile, and rasterize the lists."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.errors import UsageError
from usdsplat.images.cryptomatte import RANK, rank_pairs
from usdsplat.kernels import (
    bins,
    blend,
    cryptomatte,
    deep,
    deep_ids,
    feature,
    median,
    project,
    walk,
    weigh,
)
from usdsplat.kernels.device import Device
from usdsplat.render.deep_samples import DEEP_IDS, DeepSamples
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.matte_groups import MatteGroups
from usdsplat.render.occluders import NO_DEPTH, Occluders
from usdsplat.render.projected_splats import ProjectedSplats

WANTS = {
    "color": walk.COLOR,
    "albedo": walk.ALBEDO,
    "normals": walk.NORMALS,
    "depths": walk.DEPTHS,
    "axes": walk.AXES,
    "median": walk.MEDIAN,
    "front": walk.FRONT,
    "prims": walk.WEIGH,
    "counts": walk.COUNT,
    "deep": walk.FILL,
}
"""Product -> its flag in a walk."""
PRODUCTS = frozenset(WANTS) - {"color", "prims", "counts", "deep"}
"""Products that can be drawn in addition to colour and layers of Cryptomatte."""
COLUMNS = {
    "albedo": feature.ALBEDO,
    "normals": feature.NORMAL,
    "depths": feature.EXPECTED,
    "axes": feature.AXIS,
}
"""Product that is a sum over contributions -> first column of the features."""
PARTS = {"median": 0.5, "front": 0.0}
"""Product -> fraction of the coverage that is reached in the splat to find."""

NO_DEEP = (np.empty(0, np.float32), np.empty(0, np.float32), np.empty((0, 4), np.float32))


class TileLists:
    """Lists of the splats that touch each tile of a band.

    Args:
        window: Pixels x0, y0, x1, y1 of the band, end exclusive.
        sort_by_ray_hit: Whether splats of a pixel are sorted by their ray hits.
    Raises:
        UsageError: If splats touch 2**31 tiles or more.
    """

    def __init__(
        self,
        device: Device,
        buffers: FrameBuffers,
        splats: ProjectedSplats,
        window: tuple[int, int, int, int],
        occluders: Occluders,
        *,
        sort_by_ray_hit: bool,
    ) -> None:
        x0, y0, x1, y1 = window
        self.window = window
        self.shape = (y1 - y0, x1 - x0)
        self._device = device
        self._buffers = buffers
        self._splats = splats
        self._sort_by_ray_hit = sort_by_ray_hit
        self._occluders = occluders
        self._walks = sort_by_ray_hit or splats.keeps.size > 0 or occluders.holdout[0].size > 0
        """Whether contributions must be evaluated one by one."""
        self._grid = bins.grid_of(x0, y0, x1, y1)
        key = splats.stamp, window
        held = buffers.tiles.lists
        if held.content is None or held.content[0] != key:
            made = device.run(
                bins.tile_lists, splats.records, self._grid, bins.tiles_in(self._grid),
                4 * device.threads, buffers.tiles.get,
            )  # fmt: skip
            held.content = key, made
        self._starts, self._lists, self.pairs = held.content[1]
        if self.pairs > bins.MOST_PAIRS:
            raise UsageError("band", f"{self.pairs} pairs of splat and tile", "less than 2**31")
        self._walked: dict[str, Any] = {}
        """Product -> buffers that the walk for colour has filled too."""
        self.blocks = 0
        """Pairs of a splat and a block of 4x4 pixels blended so far; a GPU does not count them."""

    def rows_between(self, y0: int, y1: int) -> TileLists:
        """Return the lists of rows y0 to y1 - 1 of the display window, which share these arrays.

        y0 and y1 are multiples of `bins.TILE`, or ends of the band.
        """
        x0, top, x1, _ = self.window
        part = copy.copy(self)
        part.window, part.shape = (x0, y0, x1, y1), (y1 - y0, x1 - x0)
        part._grid = bins.grid_of(*part.window)
        first = (y0 // bins.TILE - top // bins.TILE) * int(part._grid["columns"][0])
        part._starts = self._starts[first : first + bins.tiles_in(part._grid) + 1]
        part._occluders = self._occluders.rows(y0 - top, y1 - top, x1 - x0)
        part._walked = {}
        return part

    @property
    def arrays(self) -> tuple[I64, I32, npt.NDArray[Any]]:
        """First pair of each tile, the lists, and the GRID record."""
        return self._starts, self._lists, self._grid

    # --- rasterizing -----------------------------------------------------------------------

    def color(
        self,
        products: frozenset[str] = frozenset(),
        mattes: Mapping[str, MatteGroups] = MappingProxyType({}),
        rank: int = RANK,
    ) -> tuple[F32, F32 | None]:
        """Draw colour. It must be drawn before other products.

        Args:
            products: The PRODUCTS that will be requested. If contributions are evaluated one by
                one, a single walk finds them for all products.
            mattes: The layers of Cryptomatte that will be requested, and their groups. Each layer
                after the first takes a further walk.
            rank: Number of pairs of id and coverage in a layer.

        Returns:
            Premultiplied RGBA in the blend space, shape (h, w, 4), and the transmittance, shape
            (h, w), if it differs from 1 - A, else None.
        """
        self._mattes, self._rank_pairs = mattes, rank_pairs(rank)
        if self._walks:
            color = self._buffers.color
            image, through = color.image(*self.shape), color.through(*self.shape)
            self._walked = {name: self._room(name) for name in products}
            out = {"color": image, "through": through, **self._walked}
            first, *others = [*mattes, ""]  # "" for a walk without a layer
            if first:
                out["prims"] = self._walked[first] = self._matte_room(first)
            wanted = products | {"color"} | ({"prims"} if first else set())
            self._walk(wanted, layer=first, **out)
            for layer in filter(None, others):
                self._walked[layer] = self._matte_room(layer)
                self._walk({"prims"}, layer=layer, prims=self._walked[layer])
            self._color, self._through = image, through
            return image, through
        self._color, self._through = self._blend("color", self._splats.records, project.RED), None
        return self._color, None

    def sums(self, name: str) -> F32:
        """Return sums of "albedo", "normals", "depths" or "axes" over all contributions, shape
        (h, w, 4).

        The channels are three numbers, for depths those of `feature.EXPECTED`, and coverage.
        """
        if self._walks:
            return self._walked[name]
        return self._blend(name, self._splats.features, COLUMNS[name])

    def painted(self, features: F32, keeps: F32 | None = None) -> F32:
        """Return sums of three numbers of each splat, columns `feature.ALBEDO` of `features`, over
        all contributions, shape (h, w, 4). `keeps` replaces the weights of mattes; None keeps them.
        """
        part = copy.copy(self)
        kept = self._splats.keeps if keeps is None else keeps
        part._splats = replace(self._splats, features=features, keeps=kept)
        part._walks = self._walks or kept.size > 0
        image: F32 = self._buffers.image("shadows").image(*self.shape)
        if part._walks:
            part._walk({"albedo"}, albedo=image)
            return image
        return part._blend("shadows", features, feature.ALBEDO)

    def median(self, name: str) -> tuple[F32, I32]:
        """Return depth and ids of one splat per pixel, shapes (h, w) and (4, h, w).

        It is that at which half of the coverage is reached, or for "front" the first.
        """
        run, keep, splats = self._device.run, self._device.keep, self._splats
        buffers = self._buffers.nearest(name)
        depth, ids = buffers.depth(*self.shape), buffers.ids(*self.shape)
        if self._walks:
            ranks, hits = self._walked[name]
        else:
            ranks, hits = buffers.ranks(*self.shape), NO_DEPTH
            run(
                median.median, splats.records, self._starts, self._lists, self._grid,
                splats.ray_hits, self._occluders.depth, splats.is_parallel, self._color,
                self._occluders.covered, np.float32(PARTS[name]), ranks,
            )  # fmt: skip
        run(
            median.resolve, ranks, splats.records, splats.order, splats.sources,
            keep(splats.layout.first_slots), keep(splats.layout.labels), depth, ids,
        )  # fmt: skip
        if self._walks:
            run(median.hold_depth, ranks, hits, NO_DEPTH, depth)
        elif self._occluders.depth.size > 0:
            run(median.hold_depth, ranks, NO_DEPTH, self._occluders.depth, depth)
        return depth, ids

    def weigh(self, layer: str) -> tuple[I32, F32]:
        """Return the groups of a layer of Cryptomatte that contribute most, and their
        contributions, shapes (h, w, kept), see `MatteBuffers`.

        `color` must have been called with the layer.
        """
        if self._walks:
            return self._walked[layer]
        splats = self._splats
        labels, count = self._labels(layer)
        groups, weights = self._matte_room(layer)
        self._device.run(
            weigh.weigh, splats.records, labels, count, self._starts, self._lists, self._grid,
            splats.ray_hits, self._occluders.depth, splats.is_parallel, groups, weights,
        )  # fmt: skip
        return groups, weights

    def deep(self, error: float, ids: tuple[str, ...] = ()) -> DeepSamples:
        """Return deep samples: every contribution, or merged runs of contributions.

        Splats must be in a linear blend space.

        Args:
            error: See `RenderSettings.deep_error`. It must be 0 with ids, because the samples of a
                run could have different ids.
            ids: The ids of samples that are needed, of DEEP_IDS and in its order.
        """
        assert not (ids and error > 0)
        resident, fetch = self._device.resident, self._device.fetch
        held = resident(self.shape, np.uint32)
        walks = self._walks or self._occluders.depth.size > 0
        if walks:
            self._walk({"counts"}, error=error, counts=held)
        else:
            self._deep(error, False, np.empty(0, np.int64), held, NO_DEEP)
        offsets = self._buffers.pixels.deep_offsets(*self.shape)
        total = int(self._device.run(deep.place, held, offsets))
        left = np.broadcast_to(np.float32(1), self.shape)
        left = left.copy() if walks else left

        def drawn(tiles: TileLists) -> tuple[F32, F32, F32]:
            memory = self._buffers.samples.take((5 if error == 0 else 6) * total)
            color = memory[: 4 * total].reshape((total, 4))
            near = memory[4 * total : 5 * total]
            far = near if error == 0 else memory[5 * total :]
            out = near, far, color
            if walks:
                tiles._walk({"deep"}, error=error, offsets=offsets, through=left, deep=out)
            else:
                tiles._deep(error, True, offsets, held, out)
            return out

        near, far, color = drawn(self)
        depth = fetch(near)
        back = depth if far is near else fetch(far)
        samples = DeepSamples(fetch(held), depth, back, fetch(color), left)
        if not ids:
            return samples
        numbered = copy.copy(self)
        numbered._splats = replace(self._splats, records=self._numbered())
        found = self._ids_of(drawn(numbered)[2], ids)
        return replace(samples, ids=found, id_names=ids, prims=self._splats.layout.prims)

    # --- private ---------------------------------------------------------------------------

    def _numbered(self) -> F32:
        """Return the splats' records with ranks in place of colours, see `kernels.deep_ids`."""
        held, splats = self._buffers.splats.numbered, self._splats
        out = held(splats.records.shape[0])
        if held.content is not splats.stamp:
            self._device.run(deep_ids.number, splats.records, out)
            held.content = splats.stamp
        return out

    def _ids_of(self, color: F32, names: tuple[str, ...]) -> I32:
        """Return the ids of deep samples that were drawn with numbered records, shape (n, k)."""
        run, keep, splats, n = self._device.run, self._device.keep, self._splats, color.shape[0]
        resident = self._device.resident
        if n == 0:
            return np.empty((0, len(names)), np.int32)
        ranks, ids = resident((n, 1), np.int32), resident((4, n, 1), np.int32)
        run(deep_ids.read_ranks, color, splats.records.shape[0], ranks)
        run(
            median.resolve, ranks, splats.records, splats.order, splats.sources,
            keep(splats.layout.first_slots), keep(splats.layout.labels),
            resident((n, 1), np.float32), ids,
        )  # fmt: skip
        if (first := splats.layout.first_elements).size:
            run(median.number_elements, ids[3], keep(first), ids[2])
        columns = [DEEP_IDS.index(name) for name in names]
        return np.ascontiguousarray(self._device.fetch(ids)[columns, :, 0].T)

    def _room(self, name: str) -> Any:
        """Return the buffers for one of PRODUCTS."""
        shape = self.shape
        if name in PARTS:
            nearest = self._buffers.nearest(name)
            return nearest.ranks(*shape), nearest.ray_depths(*shape)
        return self._buffers.image(name).image(*shape)

    def _matte_room(self, layer: str) -> tuple[I32, F32]:
        """Return the buffers for one layer of Cryptomatte."""
        buffers, shape = self._buffers.matte(layer), (*self.shape, self._rank_pairs)
        return buffers.prims(*shape), buffers.weights(*shape)

    def _labels(self, layer: str) -> tuple[I32, int]:
        """Return the group of each splat in a layer of Cryptomatte, and the number of groups; empty
        without a layer."""
        if not layer:
            return self._buffers.splats.groups(0), 0
        groups, labels = self._mattes[layer], self._splats.labels
        out = self._buffers.splats.groups(labels.shape[0])
        if labels.shape[0] > 0:
            of_prims = self._device.keep(groups.of_prims)
            self._device.run(cryptomatte.regroup, labels, of_prims, out)
        return out, len(groups.names)

    def _blend(self, name: str, paints: F32, column: int) -> F32:
        """Blend three numbers of each splat in order of depth of the centres, shape (h, w, 4)."""
        run, splats = self._device.run, self._splats
        image: F32 = self._buffers.image(name).image(*self.shape)
        work = self._buffers.tiles.work(int(self._grid["rows"][0]), int(self._grid["columns"][0]))
        height, width = self.shape
        run(
            blend.blend, splats.records, paints, column, self._starts, self._lists, self._grid,
            splats.ray_hits, self._occluders.depth, splats.is_parallel,
            image.reshape((height, 4 * width)), work,
        )  # fmt: skip
        if isinstance(work, np.ndarray):  # a GPU does not count
            self.blocks += int(work.sum())
        return image

    def _deep(
        self,
        error: float,
        writes: bool,
        offsets: I64,
        counts: npt.NDArray[np.uint32],
        samples: tuple[F32, F32, F32],
    ) -> None:
        """Count samples, or write them if `writes` is set."""
        self._device.run(
            deep.deep, self._splats.records, self._starts, self._lists, self._grid, project.RED,
            np.float32(error), writes, offsets, counts, *samples,
        )  # fmt: skip

    def _walk(
        self, wanted: AbstractSet[str], *, error: float = 0.0, layer: str = "", **out: Any
    ) -> None:
        """Walk all pixels once for all `wanted` products. `out` has the arrays that it reads and
        writes; "prims" are those of the `layer` of Cryptomatte."""
        splats = self._splats
        labels, count = self._labels(layer)
        options = (
            sum(WANTS[name] for name in wanted), self._sort_by_ray_hit, splats.is_parallel,
            count, np.float32(error), np.float32(splats.near),
        )  # fmt: skip
        no_image, no_ranks = np.empty((0, 0, 4), np.float32), np.empty((0, 0), np.int32)
        no_prims = np.empty((0, 0, weigh.RANKS), np.int32)
        nothing = {
            "color": no_image,
            "albedo": no_image,
            "normals": no_image,
            "depths": no_image,
            "axes": no_image,
            "through": NO_DEPTH,
            "median": (no_ranks, NO_DEPTH),
            "front": (no_ranks, NO_DEPTH),
            "prims": (no_prims, no_prims.view(np.float32)),
            "counts": np.empty((0, 0), np.uint32),
            "offsets": np.empty(0, np.int64),
            "deep": NO_DEEP,
        }
        self._device.run(
            walk.walk, options, splats.records, splats.features, splats.keeps, labels, self._starts,
            self._lists, self._grid, splats.ray_hits, self._occluders.depth,
            self._occluders.covered, self._occluders.holdout, tuple((nothing | out).values()),
        )  # fmt: skip
