"""Sheets: the outer surface of a capture or a mesh, as points that are spread evenly over it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32, I64, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.sim import carriers as binding_kernels
from usdsplat.kernels.sim import transport_map as kernels
from usdsplat.sim.carriers import NEAREST, WIDEN, Binding, Carriers, poisson_disk
from usdsplat.sim.normals import axes
from usdsplat.sim.parameters import NeighborsParameters, Parameters, SimParameters
from usdsplat.sim.relaxing import relax, spacing
from usdsplat.sim.target_mesh import TargetMesh

NEIGHBORS = 12
"""Neighbours of a point."""
WIDTH = 2.0
"""Width of the weights of neighbours, in spacings."""
CROWD = 16.0
"""Neighbours within the radius of a relaxation."""

PIXEL, BEHIND = 1.5, 2.0
"""Edge of a pixel of the depth images that decide what is seen from outside, and the depth behind
the first point up to which others are seen, in spacings."""
SEEN = 2
"""Number of directions from which a point of an outer surface is seen at least."""
SOLID = 0.5
"""Optical depth around a point below which it is not part of a surface; half of the median where
that is less."""
OPAQUE = 0.99
"""Opacity above which all splats count as equally opaque."""
FEWEST = 16
"""Number of carriers below which the splats themselves are the points."""

DRAWN = 6
"""Points drawn on a mesh for each one that is kept."""
CLOSEST = 0.73
"""Least distance of kept points, relative to an even spacing."""
SWEEPS = 20
"""Relaxation sweeps of points on a mesh."""
_GOLDEN = 0.7548776662466927, 0.5698402909980532, 0.6180339887498949
"""Steps of sequences that fill a square and an interval evenly (Roberts 2018; the golden ratio)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sheet:
    """c points on a surface."""

    positions: F32
    """[unit], shape (c, 3)."""
    normals: F32
    """Unit normals, shape (c, 3)."""
    near: I32
    """Neighbours of each point, itself first, -1 after the last, shape (c, k)."""
    weights: F32
    """Their weights, shape (c, k)."""
    spacing: float
    """Median of the mean distance to the six nearest [unit]."""

    @classmethod
    def of(cls, device: Device, positions: F32, normals: F32) -> Sheet:
        """Return a sheet of points; one alone has a spacing of 1."""
        near, far = nearest(device, positions, positions, NEIGHBORS + 1)
        beside = np.where(np.isfinite(far[:, 1:7]), far[:, 1:7], np.nan)
        usual = float(np.nanmedian(np.nanmean(beside, axis=1))) if len(positions) > 1 else 1.0
        usual = usual if usual > 0 else 1.0
        with np.errstate(over="ignore"):
            weights = np.exp(-np.square(far / np.float32(WIDTH * usual)))
        weights[near < 0] = 0
        return cls(
            positions=positions,
            normals=normals,
            near=near,
            weights=weights.astype(np.float32),
            spacing=usual,
        )

    def __len__(self) -> int:
        return len(self.positions)

    def selected(self, device: Device, rows: I64) -> Sheet:
        """Return a sheet of some points."""
        return Sheet.of(device, self.positions[rows], self.normals[rows])

    def thinned(self, device: Device, count: int) -> I64:
        """Return the rows of about `count` points, spread evenly; all if there are fewer."""
        n = len(self)
        if n <= count:
            return np.arange(n)
        kept, least, most = np.arange(n), 0.0, float(np.linalg.norm(np.ptp(self.positions, axis=0)))
        for _ in range(16):
            middle = (least + most) / 2
            kept = disk_sample(device, self.positions, middle)
            if len(kept) == count:
                break
            least, most = (middle, most) if len(kept) > count else (least, middle)
        return kept

    def bind(self, device: Device, points: F32) -> Binding:
        """Return the nearest points of the sheet for any points, and weights that sum to 1."""
        near, _ = nearest(device, self.positions, points, min(NEAREST, len(self)))
        weights: F32 = device.empty(near.shape, np.float32)
        device.run(
            binding_kernels.bind, points, self.positions, near, np.float32(np.inf),
            np.float32(WIDEN), weights,
        )  # fmt: skip
        return Binding(near=near, weights=weights)

    def mean(self, values: F64) -> F64:
        """Return for each point the mean of `values` at its neighbours, by their weights, (c,)."""
        weights = self.weights.astype(np.float64)
        total = (weights * values[self.near]).sum(axis=1)
        return np.asarray(total / weights.sum(axis=1))

    def stretch(self, positions: F32) -> F64:
        """Return how much farther neighbours are at other positions, shape (c, 3), than here.

        Returns:
            Ratio of the root mean squares of the distances around each point, shape (c,).
        """
        weights = self.weights.astype(np.float64)
        now, rest = (
            (weights * np.square(each[self.near] - each[:, None]).sum(axis=2)).sum(axis=1)
            for each in (positions, self.positions)
        )
        return np.sqrt(now / np.maximum(rest, 1e-30))

    def colors(self, device: Device, cloud: SplatCloud) -> F32:
        """Return the mean colours of a cloud around points, coefficients of degree 0, (c, 3)."""
        near = self.bind(device, cloud.positions).near[:, 0]
        away = np.linalg.norm(cloud.positions - self.positions[near], axis=1) / self.spacing
        base = cloud.sh[:, 0].astype(np.float64)
        sound = np.isfinite(away) & np.isfinite(base).all(axis=1) & np.isfinite(cloud.opacities)
        weight = np.where(sound, cloud.opacities * np.exp(-np.square(away)) + 1e-9, 0)
        base[~sound] = 0
        total = np.bincount(near, weight, len(self))
        sums = [np.bincount(near, weight * base[:, channel], len(self)) for channel in range(3)]
        own = np.stack(sums, axis=1)
        weights = self.weights.astype(np.float64)
        masses = (weights * total[self.near]).sum(axis=1)
        mixed = np.einsum("nk,nki->ni", weights, own[self.near])
        return (mixed / np.maximum(masses, 1e-30)[:, None]).astype(np.float32)


class MeshGoal:
    """The surface of a mesh, as a target of transport.

    Args:
        device: Runs the kernels.
        mesh: The mesh.
        count: Approximate number of points of its sheet.

    Raises:
        StageError: If the mesh has no area.
    """

    def __init__(self, device: Device, mesh: TargetMesh, count: int) -> None:
        self._device, self._mesh = device, mesh
        area = float(np.square(mesh.sizes.astype(np.float64)).sum())
        if not area > 0:
            raise StageError("mesh", "a target without area", "triangles with an area")
        even = math.sqrt(area / count)
        drawn = _drawn(mesh, DRAWN * count)
        points = drawn[disk_sample(device, drawn, CLOSEST * even)]
        points = relaxed(device, points, math.sqrt(area / len(points)), SWEEPS, self)
        self.sheet = Sheet.of(device, *self.onto(points))
        """Points spread evenly over the mesh."""

    def onto(self, points: F32) -> tuple[F32, F32]:
        """Return the closest points, and the unit normals there."""
        return self._mesh.onto(points)


class SheetGoal:
    """The surface through a sheet, as a target of transport."""

    def __init__(self, device: Device, sheet: Sheet) -> None:
        self._device, self.sheet = device, sheet

    def onto(self, points: F32) -> tuple[F32, F32]:
        """Return close points, and the unit normals there."""
        found = np.array(points, np.float32, order="C")
        normals = np.empty_like(found)
        binding = self.sheet.bind(self._device, found)
        self._device.run(
            kernels.project, binding.near, binding.weights, self.sheet.positions,
            self.sheet.normals, np.float32(self.sheet.spacing), found, normals,
        )  # fmt: skip
        return found, normals


Goal = MeshGoal | SheetGoal
"""What splats are transported to."""


def outer_sheet(device: Device, carriers: Carriers, cloud: SplatCloud) -> Sheet:
    """Return those carriers of a capture that are seen from outside and lie on something solid,
    with their normals outwards.

    Args:
        device: Runs the kernels.
        carriers: Those of the capture.
        cloud: The capture at rest.
    """
    places, normals, apart = carriers.positions, carriers.normals, carriers.spacing
    if len(places) < FEWEST:
        return Sheet.of(device, cloud.positions, axes(device, cloud.rotations, cloud.scales))
    seen, towards = _visibility(places, apart)
    depth = optical_depth(device, places, apart, cloud)
    outside = (seen >= SEEN) & (depth > 0)
    limit = SOLID * min(1.0, float(np.median(depth[outside])) if outside.any() else 1.0)
    kept = np.flatnonzero(outside & (depth >= limit))
    if len(kept) < FEWEST:
        kept = np.arange(len(places))
    inwards = np.einsum("ni,ni->n", normals, towards) < 0
    facing = np.where(inwards[:, None], -normals, normals)
    return Sheet.of(device, np.ascontiguousarray(places[kept]), np.ascontiguousarray(facing[kept]))


def optical_depth(device: Device, places: F32, apart: float, cloud: SplatCloud) -> F64:
    """Return the optical depth of a capture around points that are spread evenly over it, shape
    (c,): that of the splats for which each is the nearest, over the area of a point."""
    near, _ = nearest(device, places, cloud.positions, 1)
    sizes = np.sort(cloud.scales.astype(np.float64), axis=1)
    faces = 2 * np.pi * sizes[:, 1] * sizes[:, 2]
    depth = -np.log1p(-np.clip(cloud.opacities.astype(np.float64), 0, OPAQUE)) * faces
    return np.bincount(near[:, 0], depth, len(places)) / (apart * apart)


def relaxed(device: Device, points: F32, apart: float, sweeps: int, goal: Goal) -> F32:
    """Move points on a surface until they are evenly spaced [unit]."""
    radius = apart / spacing(CROWD, 2)
    parameters = Parameters(
        sim=SimParameters(),
        neighbors=NeighborsParameters(target=CROWD, h_min=radius, h_max=radius),
    )
    return relax(device, points, None, parameters, sweeps, goal.onto)[0]


def disk_sample(device: Device, points: F32, distance: float) -> I64:
    """Return the rows of points, ascending, of which none is closer than a distance to another."""
    order = np.argsort(np.modf(np.arange(len(points)) * _GOLDEN[2])[0], kind="stable")
    priority = np.empty(len(points), np.float32)
    priority[order] = np.arange(len(points))
    return poisson_disk(device, points, priority, distance)


def _drawn(mesh: TargetMesh, count: int) -> F32:
    """Return points on a mesh, as many on equal areas."""
    points, triangles = mesh.surface.points, mesh.surface.triangles
    ends = np.cumsum(np.square(mesh.sizes.astype(np.float64)))
    number = np.arange(count)
    faces = np.searchsorted(ends, (number + 0.5) / count * ends[-1])
    faces = np.minimum(faces, len(ends) - 1)
    a, b = (np.modf(0.5 + number * step)[0] for step in _GOLDEN[:2])
    root = np.sqrt(a)
    weights = np.stack([1 - root, root * (1 - b), root * b], axis=1)
    corners = points[triangles[faces]].astype(np.float64)
    return np.einsum("nk,nki->ni", weights, corners).astype(np.float32)


def _visibility(places: F32, apart: float) -> tuple[npt.NDArray[np.int64], F64]:
    """Return from how many of 26 directions points are the first, or close behind it, shape (n,),
    and the sum of these directions, shape (n, 3)."""
    seen, towards = np.zeros(len(places), np.int64), np.zeros((len(places), 3))
    x, y, z = places.astype(np.float64).T
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step == (0, 0, 0):
            continue
        way = np.array(step) / np.linalg.norm(step)
        side = np.cross(way, (0.3, 0.5, 0.8))
        side /= np.linalg.norm(side)
        pixels = []
        for axis in (side, np.cross(way, side)):
            place = np.floor((x * axis[0] + y * axis[1] + z * axis[2]) / (PIXEL * apart))
            pixels.append((place - place.min()).astype(np.int64))
        pixel = np.unique(pixels[0] * (pixels[1].max() + 1) + pixels[1], return_inverse=True)[1]
        depth = x * way[0] + y * way[1] + z * way[2]
        first = np.full(int(pixel.max()) + 1, -np.inf)
        np.maximum.at(first, pixel, depth)
        is_seen = depth > first[pixel] - BEHIND * apart
        seen += is_seen
        towards += np.where(is_seen[:, None], way, 0)
    return seen, towards
