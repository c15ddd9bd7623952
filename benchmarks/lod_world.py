"""Make worlds of any number of splats: a procedural city in tiles, and instances of a tree.

Every tile is a square with its own buildings, streets and trees, modelled with NumPy from a seed,
so a world has no instances and is the same on every machine. Tiles are numbered along a spiral from
the middle of the city: a larger world contains the smaller ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt

from usdsplat import schema
from usdsplat.core import edit, quaternion
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.sh import basis, rgb_to_dc

TILE = 1_000_000
"""Largest number of splats of a tile."""
EDGE = 100.0
"""Edge of a tile [m]."""
GAP = 1.02
"""Distance of instances of a tree, relative to the edge of its city."""

_BLOCKS, _STREET = 4, 8.0  # buildings along an edge, width of a street [m]
_TREES, _LEAVES = 60, 0.08  # trees of a tile, part of its splats that are leaves
_EVEN = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts' sequence R2: no holes
_FLOOR, _WINDOW = 3.2, 2.4  # height of a floor, distance of windows [m]
_SUN = np.array([0.48, 0.64, 0.60])  # direction to the sun of the highlights
_GLOSS, _GRAIN = 0.12, 0.02  # largest amplitude of highlights, and of noise, of coefficients


@dataclass(frozen=True, slots=True, eq=False)
class _Walls:
    """Upright or level rectangles."""

    corner: F64
    """Shape (n, 3)."""
    along: F64
    """First edge, shape (n, 3)."""
    up: F64
    """Second edge, shape (n, 3)."""
    color: F64
    """Shape (n, 3)."""
    has_windows: np.ndarray

    def area(self) -> F64:
        """Return the areas [m^2], shape (n,)."""
        return np.linalg.norm(np.cross(self.along, self.up), axis=1)


def spiral(count: int) -> list[tuple[int, int]]:
    """Return the columns and rows of `count` tiles along a square spiral around (0, 0)."""
    found, x, z, dx, dz, steps = [], 0, 0, 1, 0, 1
    while len(found) < count:
        for _ in range(2):
            for _ in range(steps):
                found.append((x, z))
                x, z = x + dx, z + dz
            dx, dz = -dz, dx
        steps += 1
    return found[:count]


def city_tile(number: int, splats: int, degree: int = 0) -> SplatCloud:
    """Return a tile of the city: y up, metres.

    Args:
        number: Number along the spiral; it is also the seed.
        splats: Number of splats.
        degree: Degree of the harmonics; above 0 they are a highlight of the sun and noise.
    """
    rng = np.random.default_rng(number)
    walls = _walls(rng)
    leaves = round(_LEAVES * splats)
    area = walls.area()
    counts = rng.multinomial(splats - leaves, area / area.sum())
    spacing = math.sqrt(area.sum() / max(1, splats - leaves))
    cloud = edit.merge([_covered(walls, counts, spacing, rng), _trees(leaves, rng)])
    column, row = spiral(number + 1)[number]
    cloud.positions[:] += np.float32([column * EDGE, 0, row * EDGE])
    return _glossy(cloud, degree, rng) if degree else cloud


def _glossy(cloud: SplatCloud, degree: int, rng: np.random.Generator) -> SplatCloud:
    """Return splats of degree 0 with harmonics that depend on the direction of view."""
    normals = quaternion.to_matrix(cloud.rotations)[:, :, 2]
    sun = _SUN.astype(np.float32)
    mirrored = 2 * (normals @ sun)[:, None] * normals - sun
    # harmonics are functions of the direction from the eye: the highlight is seen along −mirrored
    lobe = basis(-mirrored, degree)
    gloss = _GLOSS * rng.random((len(cloud), 1), np.float32)
    sh = rng.standard_normal((len(cloud), lobe.shape[1], 3), np.float32)
    sh *= np.float32(_GRAIN)
    sh += (gloss * lobe)[:, :, None]
    sh[:, :1] = cloud.sh
    return replace(cloud, sh=sh)


def _walls(rng: np.random.Generator) -> _Walls:
    """Return the ground and the buildings of a tile around the origin."""
    step = EDGE / _BLOCKS
    x, z = (each.ravel() for each in np.meshgrid(*2 * [(np.arange(_BLOCKS) + 0.5) * step]))
    n = len(x)
    width, depth = rng.uniform(0.6, 1, (2, n)) * (step - _STREET)
    height = np.round(rng.gamma(3.0, 2.5, n) + 2) * _FLOOR
    color = rng.uniform(0.25, 0.8, (n, 1)) * rng.uniform(0.75, 1.0, (n, 3))
    zero = np.zeros(n)
    low = np.stack([x - width / 2, zero, z - depth / 2], axis=1) - [EDGE / 2, 0, EDGE / 2]
    wide, deep = np.stack([width, zero, zero], axis=1), np.stack([zero, zero, depth], axis=1)
    tall = np.stack([zero, height, zero], axis=1)
    ground = np.array([[-EDGE / 2, 0, -EDGE / 2]])
    sides = [
        (low, wide, tall, True), (low, deep, tall, True), (low + wide, deep, tall, True),
        (low + deep, wide, tall, True), (low + tall, deep, wide, False),
    ]  # fmt: skip
    return _Walls(
        np.concatenate([ground, *(each[0] for each in sides)]),
        np.concatenate([[[0, 0, EDGE]], *(each[1] for each in sides)]),
        np.concatenate([[[EDGE, 0, 0]], *(each[2] for each in sides)]),
        np.concatenate([[[0.22, 0.24, 0.22]], *5 * [color]]),
        np.concatenate([[False], *(np.full(n, each[3]) for each in sides)]),
    )


def _covered(
    walls: _Walls, counts: np.ndarray, spacing: float, rng: np.random.Generator
) -> SplatCloud:
    """Return flat splats on rectangles, `counts` on each, about `spacing` [m] apart."""
    of = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(of)) - (np.cumsum(counts) - counts)[of]
    u, v = (_EVEN[:, None] * within + rng.random((2, len(counts)))[:, of]) % 1
    along, up = walls.along[of], walls.up[of]
    positions = walls.corner[of] + u[:, None] * along + v[:, None] * up
    across = u * np.linalg.norm(along, axis=1)
    high = v * np.linalg.norm(up, axis=1)
    in_window = (across % _WINDOW > 0.8) & (high % _FLOOR > 1.1) & walls.has_windows[of]
    grain = 0.12 * np.sin(0.9 * positions).sum(axis=1) + rng.normal(0, 0.04, len(of))
    color = np.where(in_window[:, None], [0.10, 0.14, 0.20], walls.color[of])
    color = np.clip(color * (1 + grain)[:, None], 0.01, 1)
    sizes = rng.lognormal(0, 0.25, (len(of), 3)) * spacing * [0.75, 0.6, 0.1]
    # the short axis z of the splats is turned to the normal, and the others at random about it
    normals = np.cross(walls.along, walls.up)
    turned = quaternion.from_matrix(_frames(normals / np.linalg.norm(normals, axis=1)[:, None]))
    angle = rng.uniform(0, math.pi, len(of))
    spin = np.stack([np.cos(angle), 0 * angle, 0 * angle, np.sin(angle)], axis=1)
    return _splats(
        positions, sizes, quaternion.multiply(turned[of], spin),
        rng.uniform(0.75, 1.0, len(of)), color,
    )  # fmt: skip


def _frames(normals: F64) -> F64:
    """Return rotations whose third column is a normal, shape (n, 3, 3)."""
    helper = np.where(np.abs(normals[:, 1:2]) > 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(helper, normals)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normals, first), normals], axis=2)


def _trees(count: int, rng: np.random.Generator) -> SplatCloud:
    """Return the leaves of trees along the streets of a tile around the origin."""
    step = EDGE / _BLOCKS
    lines = step * rng.integers(0, _BLOCKS, (_TREES, 1)) - EDGE / 2 + 2.0
    roots = np.concatenate([lines, rng.uniform(-EDGE / 2, EDGE / 2, (_TREES, 1))], axis=1)
    roots = np.where(rng.random((_TREES, 1)) < 0.5, roots, roots[:, ::-1])
    of = rng.integers(0, _TREES, count)
    radius = rng.uniform(1.2, 2.4, _TREES)[of]
    offset = rng.normal(size=(count, 3))
    offset *= (radius * rng.random(count) ** 0.4 / np.linalg.norm(offset, axis=1))[:, None]
    positions = offset + np.stack([roots[of, 0], radius + 2.0, roots[of, 1]], axis=1)
    green = rng.uniform([0.05, 0.18, 0.03], [0.20, 0.42, 0.10], (_TREES, 3))[of]
    shade = 0.5 + 0.5 * np.clip(offset[:, 1:2] / radius[:, None] + 0.5, 0, 1)
    rotations = rng.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1)[:, None]
    sizes = rng.uniform(0.02, 0.12, (count, 3))
    opacities = rng.uniform(0.4, 0.95, count)
    return _splats(positions, sizes, rotations, opacities, green * shade)


def _splats(positions: F64, scales: F64, rotations: F64, opacities: F64, color: F64) -> SplatCloud:
    """Return splats of degree 0."""
    return SplatCloud(
        positions=positions.astype(np.float32),
        scales=scales.astype(np.float32),
        rotations=rotations.astype(np.float32),
        opacities=opacities.astype(np.float32),
        sh=rgb_to_dc(color.astype(np.float32))[:, None],
    )


# --- files --------------------------------------------------------------------------------


def write_tiles(folder: Path, splats: int, *, processes: int, degree: int = 0) -> list[Path]:
    """Write a city as packed stages, one for each tile, and return their paths.

    Tiles that exist are kept.

    Args:
        folder: Folder of the tiles.
        splats: Number of splats.
        processes: Number of processes.
        degree: Degree of the harmonics.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sizes = [min(TILE, splats - first) for first in range(0, splats, TILE)]
    kind = f"_sh{degree}" if degree else ""
    paths = [folder / f"tile_{number:04d}_{size}{kind}.usdc" for number, size in enumerate(sizes)]
    missing = [number for number, path in enumerate(paths) if not path.exists()]
    write = partial(_write_tile, paths, sizes, degree)
    if min(processes, len(missing)) > 1:
        with ProcessPoolExecutor(processes) as pool:
            list(pool.map(write, missing))
    else:
        for number in missing:
            write(number)
    return paths


def _write_tile(paths: Sequence[Path], sizes: Sequence[int], degree: int, number: int) -> None:
    """Write one tile; a file that exists is complete."""
    path = paths[number]
    part = path.with_name(f"part_{path.name}")
    stage = Usd.Stage.CreateNew(str(part))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    cloud = city_tile(number, sizes[number], degree)
    stage.SetDefaultPrim(schema.author(stage, "/tile", cloud, form="packed"))
    stage.GetRootLayer().Save()
    part.rename(path)


def write_instances(path: Path, tree: Path, copies: int, edge: float) -> None:
    """Write a stage with a point instancer whose instances are copies of a tree on a square grid;
    the first one is in the middle.

    Args:
        path: The stage, in the folder of the tree.
        tree: The tree.
        copies: Number of instances.
        edge: Edge of the tree's city [m].
    """
    path.unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    instancer = UsdGeom.PointInstancer.Define(stage, "/world/cities")
    prototype = stage.DefinePrim("/world/cities/city", "Xform")
    prototype.GetReferences().AddReference(f"./{tree.name}")
    instancer.CreatePrototypesRel().SetTargets([prototype.GetPath()])
    places = [Gf.Vec3f(x * edge * GAP, 0, z * edge * GAP) for x, z in spiral(copies)]
    instancer.CreatePositionsAttr(Vt.Vec3fArray(places))
    instancer.CreateProtoIndicesAttr(Vt.IntArray([0] * copies))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/world"))
    stage.GetRootLayer().Save()


def city_edge(splats: int) -> float:
    """Return the edge of the square that holds a city of a number of splats [m]."""
    tiles = -(-splats // TILE)
    return EDGE * math.ceil(math.sqrt(tiles))
