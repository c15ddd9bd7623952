"""Replace lights by directions and points. They depend on the light alone, not on the picture, so
that nothing flickers; their number is a knob."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.kernels import lighting
from usdsplat.render.lights.dome import cell_radiance
from usdsplat.render.lights.specs import LightKind, LightSpec

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""Angle between consecutive points of a Fibonacci lattice [rad]."""


def samples_of(light: LightSpec, count: int) -> npt.NDArray[np.void]:
    """Return about `count` samples of a light, as LIGHT records.

    Their sum over any receiver approaches the light's own irradiance. A light without an extent has
    one sample. Rects and cylinders have a number that is a product. Samples of a dome are those of
    its sky without peaks; directions are the same for all domes.
    """
    if light.kind == "distant":
        return _distant(light, count)
    if light.kind == "dome":
        return _sky(light, count)
    matrix = np.array(light.to_world, np.float64).reshape(4, 4)
    linear, place = matrix[:3, :3], matrix[:3, 3]
    size = area(light.kind, light.size, linear)
    if light.is_point or size == 0.0 or count == 1:
        return _point(light, linear, place, size)
    points, normals = _surface(light, count)
    cofactors = np.linalg.det(linear) * np.linalg.pinv(linear).T
    if np.linalg.det(linear) < 0:  # cofactors of a mirroring matrix turn normals over
        cofactors = -cofactors
    normals = normals @ cofactors.T
    areas = np.linalg.norm(normals, axis=1)
    found = _records(light, len(points))
    found["kind"] = lighting.ONE_SIDE
    _write(found, "xyz", points @ linear.T + place)
    safe = np.where(areas > 0, areas, 1.0)
    _write(found, ("nx", "ny", "nz"), normals / safe[:, None])
    weights = areas / areas.sum() * size / math.pi
    _write(found, ("red", "green", "blue"), weights[:, None] * np.array(light.radiance))
    return found


def area(kind: LightKind, size: tuple[float, float], linear: F64) -> float:
    """Return the area of a light in the world [unit²].

    Args:
        size: See `LightSpec.size`.
        linear: Upper 3x3 of local to world.
    """
    if kind == "rect":
        return float(np.linalg.norm(np.cross(linear[:, 0], linear[:, 1])) * size[0] * size[1])
    if kind == "disk":
        whole = np.linalg.norm(np.cross(linear[:, 0], linear[:, 1]))
        return float(math.pi * size[0] ** 2 * whole)
    scale = abs(float(np.linalg.det(linear))) ** (1.0 / 3.0)
    if kind == "sphere":
        return 4.0 * math.pi * (size[0] * scale) ** 2
    along = float(np.linalg.norm(linear[:, 0]))
    across = math.sqrt(float(np.linalg.norm(np.cross(linear[:, 1], linear[:, 2]))))
    return 2.0 * math.pi * size[0] * across * size[1] * along


def disk_points(count: int) -> F64:
    """Return points of equal area in the unit disk, a Vogel spiral, shape (count, 2)."""
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * GOLDEN
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def sphere_points(count: int) -> F64:
    """Return points of equal area on the unit sphere, a Fibonacci lattice, shape (count, 3)."""
    i = np.arange(count)
    z = 1.0 - (2.0 * i + 1.0) / count
    radius, angle = np.sqrt(1.0 - z * z), i * GOLDEN
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def frame_about(axis: F64) -> F64:
    """Return a rotation whose third column is a unit axis, shape (3, 3)."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    right = np.cross(other, axis)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(axis, right), axis], axis=1)


# --- private -------------------------------------------------------------------------------


def _distant(light: LightSpec, count: int) -> npt.NDArray[np.void]:
    """Return directions of equal solid angle within the light's cone."""
    towards = -np.array(light.direction, np.float64)
    half = min(abs(light.angle), math.pi) / 2
    found = _records(light, count if half > 0 else 1)
    spots, cosines = np.zeros((len(found), 2)), np.ones(len(found))
    if len(found) > 1:
        disk = disk_points(len(found))
        square = (disk**2).sum(axis=1)
        cosines = 1.0 - square * (1.0 - math.cos(half))
        spots = disk * (np.sqrt(1.0 - cosines**2) / np.sqrt(square))[:, None]
    local = np.concatenate([spots, cosines[:, None]], axis=1)
    _write(found, "xyz", local @ frame_about(towards).T)
    found["kind"] = lighting.DISTANT
    _write(found, ("red", "green", "blue"), np.array(light.irradiance) / cosines.sum())
    return found


def _sky(light: LightSpec, count: int) -> npt.NDArray[np.void]:
    """Return the directions from which light of a dome comes, each with that of its cell."""
    directions = sphere_points(count)
    cells = cell_radiance(light, directions)
    found = _records(light, count)
    found["kind"] = lighting.DISTANT
    _write(found, "xyz", directions)
    _write(found, ("red", "green", "blue"), cells)
    return found


def _point(light: LightSpec, linear: F64, place: F64, size: float) -> npt.NDArray[np.void]:
    """Return the one sample of a light that is taken for a point."""
    found = _records(light, 1)
    _write(found, "xyz", place[None])
    is_flat = light.kind in ("rect", "disk")
    found["kind"] = lighting.ONE_SIDE if is_flat else lighting.EVERY_WAY
    normal = -np.cross(linear[:, 0], linear[:, 1]) * np.sign(np.linalg.det(linear) or 1.0)
    length = float(np.linalg.norm(normal))
    _write(found, ("nx", "ny", "nz"), normal[None] / (length or 1.0))
    # a sphere radiates by its cross section, a quarter of its area
    part = (size or 1.0) * (1.0 if is_flat else 0.25)
    _write(found, ("red", "green", "blue"), np.array(light.radiance)[None] * part / math.pi)
    return found


def _surface(light: LightSpec, count: int) -> tuple[F64, F64]:
    """Return points of equal area of a light's surface and their normals, in local space."""
    if light.kind == "sphere":
        normals = sphere_points(count)
        return light.size[0] * normals, normals
    if light.kind == "cylinder":
        radius, length = light.size
        k = max(1, round(math.sqrt(count)))
        turn, along = np.meshgrid((np.arange(k) + 0.5) / k, (np.arange(k) + 0.5) / k)
        # consecutive rings are turned, so that all angles differ
        angle = 2.0 * math.pi * (turn + along / k).ravel()
        normals = np.stack([np.zeros(k * k), np.cos(angle), np.sin(angle)], axis=1)
        points = radius * normals
        points[:, 0] = length * (along.ravel() - 0.5)
        return points, normals
    if light.kind == "disk":
        spots = light.size[0] * disk_points(count)
    else:
        k = max(1, round(math.sqrt(count)))
        steps = (np.arange(k) + 0.5) / k - 0.5
        spots = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2) * np.array(light.size)
    points = np.concatenate([spots, np.zeros((len(spots), 1))], axis=1)
    return points, np.broadcast_to(np.array([0.0, 0.0, -1.0]), points.shape)


def _records(light: LightSpec, count: int) -> npt.NDArray[np.void]:
    """Return LIGHT records with everything that the samples of a light share."""
    found, shaping, shadow = np.zeros(count, lighting.LIGHT), light.shaping, light.shadow
    found["ax"], found["ay"], found["az"] = light.axis
    found["focus"] = shaping.focus
    found["tint_red"], found["tint_green"], found["tint_blue"] = shaping.tint
    found["cone_end"] = shaping.angle
    found["cone_start"] = shaping.angle * (1.0 - min(max(shaping.softness, 0.0), 1.0))
    found["shadow_red"], found["shadow_green"], found["shadow_blue"] = shadow.color
    found["distance"], found["falloff"], found["gamma"] = (
        shadow.distance, shadow.falloff, shadow.gamma,
    )  # fmt: skip
    found["casts"], found["face"] = shadow.enable, lighting.ALL_FACES
    return found


def _write(records: npt.NDArray[np.void], names: str | tuple[str, ...], values: F64) -> None:
    """Write columns of `values` to fields of records."""
    rows = np.broadcast_to(values, (len(records), len(names)))
    for name, column in zip(names, rows.T, strict=True):
        records[name] = column
