"""Carry splats along a transport map, and bind them to the triangles that they land on."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import landing as kernels
from usdsplat.kernels.sim import transport_map as map_kernels
from usdsplat.sim.carriers import Binding
from usdsplat.sim.following import Motion, follow
from usdsplat.sim.grounds import Footing, Ground
from usdsplat.sim.sheets import OPAQUE, Sheet
from usdsplat.sim.transport_map import TransportMap

BAND = (0.6, 1.6)
"""Least and largest stretch of splats along the surface, relative to the ratio of spacings."""
ACROSS = 0.2
"""Factor on sizes across the surface, relative to the ratio of spacings."""
LARGEST = 1.0
"""Largest standard deviation of a splat on the target, in spacings."""
CURVED = 0.25
"""The same in radii of curvature: larger flat splats stand out from a round limb."""
SMALLEST = 0.15
"""What that leaves at least, in spacings."""
SUNK = 0.8
"""Depth of flat splats below a curved surface, relative to their squared standard deviation times
its curvature, so that they do not stand out from its silhouette."""
TORN = 2.5
"""Unit of the differences between the motions of carriers at which they lose weight in `follow`,
in spacings: images are spread evenly, not smoothly."""
DENSE = 3.5
"""Optical depth that splats are enlarged to: 5% of the light passes."""
MOST_GROWTH = 2.0
"""Largest factor of that enlargement."""
_ARRAYS = (
    "images", "image_normals", "maps", "proper", "growth", "curvature", "bows", "order", "colors",
)  # fmt: skip
_FAR = np.float32(1e30)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Carried:
    """Binding of n splats to triangles."""

    faces: I32
    """Triangles, shape (n,)."""
    places: F32
    """Barycentric weights, shape (n, 3)."""
    heights: F32
    """Heights over the surface, with the capture's whole thickness [unit], shape (n,)."""
    depths: F32
    """Depths below the surface [unit], shape (n,)."""
    turns: F32
    """Rotation in the triangle's frame, shape (n, 4)."""
    stretches: F32
    """Stretch at rest: xx, xy, xz, yy, yz, zz, shape (n, 6)."""
    sizes: F32
    """Sizes of the triangles when splats were bound [unit], shape (n,)."""
    bows: F32
    """Direction of the arc of each path, as long as the way [unit], shape (n, 3)."""
    points: I32
    """Row of the point of the map that is nearest to each splat, shape (n,)."""
    colors: F32
    """Mean colour around each splat, coefficients of degree 0, shape (n, 3)."""

    @classmethod
    def of(cls, arrays: dict[str, npt.NDArray[Any]]) -> Self:
        """Return the result of `arrays`."""
        return cls(**{each.name: arrays[each.name] for each in fields(cls)})

    @classmethod
    def nothing(cls) -> Self:
        """Return the binding of no splats."""
        wide = {"places": 3, "turns": 4, "stretches": 6, "bows": 3, "colors": 3}
        flat = {name: np.zeros(0, np.float32) for name in ("heights", "depths", "sizes")}
        tall = {name: np.zeros((0, k), np.float32) for name, k in wide.items()}
        none = np.zeros(0, np.int32)
        return cls(faces=none, points=none, **flat, **tall)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all arrays by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def selected(self, rows: npt.NDArray[np.integer[Any]]) -> Self:
        """Return the binding of these rows."""
        return self.of({name: each[rows] for name, each in self.arrays().items()})

    def joined(self, others: Self) -> Self:
        """Return this binding, with the last rows replaced by those of others."""
        n = len(self.faces) - len(others.faces)
        mine, more = self.arrays(), others.arrays()
        return self.of({k: np.concatenate([mine[k][:n], more[k]]) for k in mine})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Landing:
    """Where n splats of any size land on a target, as it was when the map was made."""

    ground: Ground
    binding: Binding
    """Points of the map that each splat follows."""
    footing: Footing
    """Points of the target."""
    normals: F32
    """Normals of the source there, shape (n, 3)."""
    heights: F32
    """Heights over the source [unit], shape (n,)."""
    gradient: F32
    """Gradients that do not mirror, shape (n, 3, 3)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Carrying:
    """A map of points with what splats take from it."""

    device: Device
    source: Sheet
    images: F32
    """[unit], shape (c, 3)."""
    image_normals: F32
    """Unit normals there, shape (c, 3)."""
    spacing: float
    """Spacing of the images [unit]."""
    maps: F32
    """Gradients that may mirror, for positions, shape (c, 3, 3)."""
    proper: F32
    """Gradients that do not mirror, shape (c, 3, 3)."""
    growth: F32
    """Factor on the sizes of splats, which closes gaps, shape (c,)."""
    curvature: F32
    """Curvature of the target around each point [1/unit], shape (c,)."""
    bows: F32
    """Directions of the arcs of paths, as long as the way [unit], shape (c, 3)."""
    order: F32
    """Rank of each point by the length or the height of its way, 0..1, shape (c,)."""
    colors: F32
    """Mean colours of the splats around each point, coefficients of degree 0, shape (c, 3)."""

    @classmethod
    def along(
        cls,
        device: Device,
        found: TransportMap,
        ground: Ground,
        rest: SplatCloud,
        *,
        down: F32 | None = None,
    ) -> tuple[Carrying, Landing]:
        """Carry splats along a map. Return how, and where the capture's own land.

        Args:
            device: Runs the kernels.
            found: The map.
            ground: Its target.
            rest: The capture at rest, whose sizes are chosen so that they cover the target.
            down: Direction in which splats start one after the other, shape (3,); None starts
                those with the shortest way first.
        """
        c = len(found.source)
        plain = cls(
            device=device,
            source=found.source,
            images=found.images,
            image_normals=found.ups,
            spacing=found.spacing,
            maps=found.gradients(device, BAND, ACROSS, mirrors=True),
            proper=found.gradients(device, BAND, ACROSS, mirrors=False),
            growth=np.ones(c, np.float32),
            curvature=_curvature(found),
            bows=_bows(device, found),
            order=_order(found, down),
            colors=found.source.colors(device, rest),
        )
        landing = plain.landing(ground, rest.positions)
        return replace(plain, growth=plain._needed(landing, rest)), landing

    @classmethod
    def of(cls, device: Device, arrays: dict[str, npt.NDArray[Any]]) -> Carrying:
        """Return the result of `arrays`."""
        source = Sheet.of(device, arrays["positions"], arrays["normals"])
        names = _ARRAYS
        return cls(
            device=device,
            source=source,
            spacing=float(arrays["spacing"]),
            **{name: arrays[name] for name in names},
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return what `of` needs."""
        names = _ARRAYS
        return {
            "positions": self.source.positions,
            "normals": self.source.normals,
            "spacing": np.array(self.spacing),
            **{name: getattr(self, name) for name in names},
        }

    def ranks(self, landing: Landing) -> F32:
        """Return the rank of splats by the order of points, 0..1, shape (n,)."""
        return read(self.order[:, None], landing)[:, 0].copy()

    def started(self, landing: Landing, ranks: F32) -> Carrying:
        """Return a map whose points have the mean rank of the splats there, ranks of shape (n,)."""
        near, c = landing.binding.near[:, 0], len(self.order)
        count = np.bincount(near, minlength=c)
        mean = np.bincount(near, ranks, c) / np.maximum(count, 1)
        return replace(self, order=np.where(count > 0, mean, self.order).astype(np.float32))

    def landing(self, ground: Ground, positions: F32) -> Landing:
        """Return where splats land.

        Args:
            ground: The target as it was when the map was made.
            positions: The splats at rest, shape (n, 3).
        """
        n, run, source = len(positions), self.device.run, self.source
        binding = source.bind(self.device, positions)
        feet, normals = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
        heights = np.empty(n, np.float32)
        run(
            kernels.anchor, positions, binding.near, binding.weights, source.positions,
            source.normals, np.float32(source.spacing), feet, normals, heights,
        )  # fmt: skip
        gradient = np.empty((n, 3, 3), np.float32)
        gradient[:] = np.eye(3, dtype=np.float32)
        moved = self.images - source.positions
        motion = Motion(
            poses=source.positions,
            displacements=moved,
            maps=self.proper,
            spacing=TORN * self.spacing,
        )
        follow(self.device, binding, motion, feet.copy(), gradient)
        motion = Motion(
            poses=source.positions,
            displacements=moved,
            maps=self.maps,
            spacing=TORN * self.spacing,
        )
        follow(self.device, binding, motion, feet)
        return Landing(
            ground=ground,
            binding=binding,
            footing=ground.under(feet),
            normals=normals,
            heights=heights,
            gradient=gradient,
        )

    def land(self, landing: Landing, rotations: F32, scales: F32) -> Carried:
        """Bind splats to the target, rotations and scales at rest, shapes (n, 4), (n, 3)."""
        return self._landed(landing, rotations, scales)[0]

    def _landed(self, landing: Landing, rotations: F32, scales: F32) -> tuple[Carried, F32]:
        """Return the binding of splats, and the products of their two largest standard
        deviations."""
        n, source, binding = len(rotations), self.source, landing.binding
        ground, under = landing.ground, landing.footing
        ratio = self.spacing / source.spacing
        bows = np.einsum("nk,nki->ni", binding.weights, self.bows[binding.near])
        growth, curvature = (
            (binding.weights * each[binding.near]).sum(axis=1).astype(np.float32)
            for each in (self.growth, self.curvature)
        )
        limits = np.clip(
            CURVED / np.maximum(curvature, 1e-30), SMALLEST * self.spacing, LARGEST * self.spacing
        )
        how = tuple(np.float32(ratio * each) for each in (*BAND, ACROSS))
        turns, stretches = np.empty((n, 4), np.float32), np.empty((n, 6), np.float32)
        lengths = np.empty((n, 2), np.float32)
        self.device.run(
            kernels.land, landing.gradient, landing.normals, under.ups, rotations, scales,
            (growth, limits.astype(np.float32)), how,
            (under.faces, ground.frames), turns, stretches, lengths,
        )  # fmt: skip
        depths = np.float32(SUNK) * curvature * lengths[:, 0] ** 2
        heights = landing.heights * np.float32(ratio)
        places, heights, depths = ground.placed(under, heights, depths)
        carried = Carried(
            faces=under.faces,
            places=places,
            heights=heights,
            depths=depths,
            turns=turns,
            stretches=stretches,
            sizes=ground.sizes[under.faces],
            bows=bows.astype(np.float32),
            points=binding.near[:, 0].copy(),
            colors=read(self.colors, landing),
        )
        return carried, lengths.prod(axis=1)

    def _needed(self, landing: Landing, rest: SplatCloud) -> F32:
        """Return the growth around each point that makes the splats there opaque, shape (c,)."""
        _, areas = self._landed(landing, rest.rotations, rest.scales)
        near = landing.binding.near[:, 0]
        opacities = np.clip(rest.opacities.astype(np.float64), 0, OPAQUE)
        depth = -np.log1p(-opacities) * 2 * np.pi * areas
        depth = np.bincount(near, depth, len(self.source)) / self.spacing**2
        around = self.source.mean(depth)
        least = np.maximum(np.minimum(depth, around), 1e-6)
        growth = np.clip(np.sqrt(DENSE / least), 1, MOST_GROWTH)
        return self.source.mean(growth).astype(np.float32)

    def stretch(self, way: F32, arc: float) -> F32:
        """Return how far points that are on their way are torn from their neighbours, relative to
        the spacing between that of the source and that of the target, shape (c,).

        Args:
            way: Progress of each point, 0..1, shape (c,).
            arc: Height of the arcs, relative to the way.
        """
        source, part = self.source, way[:, None]
        now = (1 - part) * source.positions + part * self.images
        now += np.float32(4 * arc) * part * (1 - part) * self.bows
        usual = 1 + (self.spacing / source.spacing - 1) * way
        return source.mean(source.stretch(now) / usual).astype(np.float32)


def read(values: F32, landing: Landing) -> F32:
    """Interpolate values of a map's points, shape (c, k), at splats at rest, shape (n, k)."""
    binding = landing.binding
    return np.einsum("nk,nki->ni", binding.weights, values[binding.near]).astype(np.float32)


def _bows(device: Device, found: TransportMap) -> F32:
    """Return directions of arcs: across the way, on the outer side of both surfaces."""
    way = (found.images - found.source.positions).astype(np.float64)
    length = np.linalg.norm(way, axis=1, keepdims=True)
    along = way / np.maximum(length, 1e-30)
    out = (found.source.normals + found.ups).astype(np.float64) / 2
    out -= np.einsum("ni,ni->n", out, along)[:, None] * along
    rough = np.ascontiguousarray(length * out, np.float32)
    even = np.empty_like(rough)
    device.run(map_kernels.smooth, found.source.near, found.source.weights, rough, _FAR, even)
    return even


def _curvature(found: TransportMap) -> F32:
    """Return the largest curvature of the target around each point [1/unit], shape (c,)."""
    near, weights = found.source.near, found.source.weights.astype(np.float64)
    apart = np.linalg.norm(found.images[near] - found.images[:, None], axis=2).astype(np.float64)
    turned = np.linalg.norm(found.ups[near] - found.ups[:, None], axis=2).astype(np.float64)
    weights = np.where((apart > 0) & (apart < 4 * found.spacing), weights, 0)
    bent = np.square(turned / np.where(apart > 0, apart, 1))
    total = np.maximum(weights.sum(axis=1), 1e-30)
    # the mean over directions of the squared curvature of a cylinder is 3/8 of the largest
    return np.sqrt((weights * bent).sum(axis=1) / total * 8 / 3).astype(np.float32)


def _order(found: TransportMap, down: F32 | None) -> F32:
    """Return the order in which points start, from 0 for the first to 1 for the last, shape (c,).

    Args:
        found: Where points start and where they arrive.
        down: Direction along which they start one after the other; None starts those with the
            shortest way first.
    """
    n, start = len(found.images), found.source.positions
    if down is None:
        value = np.linalg.norm(found.images - start, axis=1)
    else:  # where a way ends counts as much as where it starts, so that a front passes both
        value = _part(start @ down) + _part(found.images @ down)
    ranks = np.empty(n, np.float32)
    ranks[np.argsort(value, kind="stable")] = np.linspace(0, 1, n, dtype=np.float32)
    return ranks


def _part(values: F32) -> F32:
    """Return values scaled so that the lowest is 0 and the highest is 1, shape (c,)."""
    low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
    return np.asarray((values - np.float32(low)) / np.float32(max(high - low, 1e-30)), np.float32)
