"""Split the sky of a dome into a smooth part and its brightest peaks.

The smooth part lights by its harmonics, so that its irradiance does not depend on the number of
directions in which its visibility is sampled. Peaks, such as the sun, are distant lights. Together
they have the light of the whole picture.

Source: Ramamoorthi & Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps";
UsdLux and OpenEXR for the axes of latlong pictures.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from usdsplat.core import sh
from usdsplat.core.cloud import F32, F64
from usdsplat.images.texture import LUMINANCE
from usdsplat.kernels.domes import DEGREE
from usdsplat.render.lights.specs import DomeSky, LightSpec, Peak

ROWS = 64
"""Rows of the grid that keeps the smooth part; it has twice as many columns."""
WIDEST = 2048
"""Width to which pictures are reduced before peaks are found [pixel]."""
THRESHOLD = 8.0
"""Multiple of the mean luminance of the rest above which a pixel may be of a peak."""
ROUNDS = 12
"""Number of steps to find this mean."""
RADIUS = math.radians(8.0)
"""Half angle of the largest peak; its glow is within it."""
LEAST = 0.01
"""Least part of the light of a dome that a peak has."""
MOST_PEAKS = 4

COSINE = (1.0, 2.0 / 3.0, 0.25, 0.0, -1.0 / 24.0)
"""Harmonics of the cosine of an angle, at least 0, divided by π: degrees 0 to 4."""


def split(pixels: F32) -> tuple[DomeSky, int]:
    """Return a picture as a sky, and the number of its pixels that are no light.

    Args:
        pixels: Radiance, linear Rec.709, latlong: row 0 is at +y, the middle looks along +z and
            the columns right of it along −x. Shape (h, w, 3). Negative values and those that are
            not finite count as 0.
    """
    wrong = int((~(np.isfinite(pixels) & (pixels >= 0))).any(axis=2).sum())
    if wrong:
        pixels = np.where(np.isfinite(pixels) & (pixels >= 0), pixels, np.float32(0))
    step = -(-pixels.shape[1] // WIDEST)
    image = _reduced(pixels, -(-pixels.shape[0] // step), -(-pixels.shape[1] // step))
    angles, directions = solid_angles(*image.shape[:2]), directions_of(*image.shape[:2])
    limit, peaks = _limit(image, angles), []
    for _ in range(MOST_PEAKS):
        peak = _take_peak(image, angles, directions, limit)
        if peak is None:
            break
        peaks.append(peak)
    grid = _reduced(image, ROWS, 2 * ROWS)
    return DomeSky(grid=grid.astype(np.float32).tobytes(), peaks=tuple(peaks)), wrong


@lru_cache(maxsize=1)
def plain_sky() -> DomeSky:
    """Return the sky of a dome without a picture: radiance 1 everywhere."""
    return split(np.ones((1, 1, 3), np.float32))[0]


def solid_angles(rows: int, columns: int) -> F64:
    """Return the solid angles of the pixels of a latlong picture [sr], shape (rows, 1)."""
    cosines = np.cos(np.linspace(0.0, math.pi, rows + 1))
    found: F64 = (cosines[:-1] - cosines[1:])[:, None] * (2.0 * math.pi / columns)
    return found


def directions_of(rows: int, columns: int) -> F64:
    """Return unit vectors to the pixels of a latlong picture, shape (rows, columns, 3). Their y is
    the mean of each row, so that sums over rows are exact for linear functions."""
    cosines = np.cos(np.linspace(0.0, math.pi, rows + 1))
    y = 0.5 * (cosines[:-1] + cosines[1:])[:, None]
    turn = math.pi * (1.0 - 2.0 * (np.arange(columns) + 0.5) / columns)
    across = np.sqrt(1.0 - y * y)
    return np.stack([across * np.sin(turn), y + 0.0 * turn, across * np.cos(turn)], axis=2)


def peak_lights(light: LightSpec) -> tuple[LightSpec, ...]:
    """Return the peaks of a dome as distant lights."""
    if light.sky is None:
        return ()
    turn, radiance = rotation(light), np.array(light.radiance)
    found = []
    for peak in light.sky.peaks:
        x, y, z = (-turn @ np.array(peak.direction)).tolist()
        red, green, blue = (radiance * np.array(peak.irradiance)).tolist()
        found.append(
            LightSpec(
                direction=(x, y, z), irradiance=(red, green, blue), angle=peak.angle,
                shadow=light.shadow, linked=light.linked, casters=light.casters,
            )
        )  # fmt: skip
    return tuple(found)


def rotation(light: LightSpec) -> F64:
    """Return the rotation from a dome to the world, shape (3, 3): its transform without scale."""
    left, _, right = np.linalg.svd(np.array(light.to_world).reshape(4, 4)[:3, :3])
    found: F64 = left @ right
    return found


def smooth_light(light: LightSpec) -> tuple[F32, F32]:
    """Return the light of a dome without its peaks on white surfaces, by their normals.

    Returns:
        Its mean over all normals, shape (3,), and harmonics of its ratio to this mean in the form
        of `radiance.harmonics`, shape (25, 3).
    """
    assert light.sky is not None
    return _smooth_light(light.sky.grid, rotation(light).tobytes(), light.radiance)


@lru_cache(maxsize=16)
def _smooth_light(
    grid: bytes, turn: bytes, radiance: tuple[float, float, float]
) -> tuple[F32, F32]:
    """Return `smooth_light` of a grid in a rotated dome."""
    directions = directions_of(ROWS, 2 * ROWS).reshape(-1, 3)
    world = directions @ np.frombuffer(turn).reshape(3, 3).T
    weights = np.broadcast_to(solid_angles(ROWS, 2 * ROWS), (ROWS, 2 * ROWS)).reshape(-1, 1)
    found = sh.basis(world, DEGREE).T @ (_grid(grid) * weights)
    for degree, factor in enumerate(COSINE):
        found[degree * degree : (degree + 1) ** 2] *= factor
    mean = sh.C0 * found[0]
    ratios = found / np.where(mean > 0, mean, 1.0)
    # the kernel adds 0.5, and all other harmonics have a mean of 0
    ratios[0] = 0.5 / sh.C0
    return (mean * np.array(radiance)).astype(np.float32), ratios.astype(np.float32)


def strongest_light(light: LightSpec) -> float:
    """Return the most light that a dome, with its peaks, gives a white surface that faces one of
    its axes, either way, or a peak; the largest of three colours.

    Nothing hides the dome. A uniform one gives its radiance in each direction.
    """
    assert light.sky is not None
    peaks = np.array([each.direction for each in light.sky.peaks]).reshape(-1, 3)
    normals = np.concatenate([np.eye(3), -np.eye(3), peaks])
    cosines = np.maximum(directions_of(ROWS, 2 * ROWS).reshape(-1, 3) @ normals.T, 0.0)
    weights = cosines * np.repeat(solid_angles(ROWS, 2 * ROWS), 2 * ROWS)[:, None]
    found = (weights / weights.sum(axis=0)).T @ _grid(light.sky.grid)
    colors = np.array([each.irradiance for each in light.sky.peaks]).reshape(-1, 3)
    found += np.maximum(normals @ peaks.T, 0.0) @ colors
    return float((found * np.array(light.radiance)).max())


def cell_radiance(light: LightSpec, directions: F64) -> F64:
    """Return the light of a dome without its peaks from the cells around directions in the world:
    radiance × solid angle / π, shape (n, 3). A pixel is of the cell of the nearest direction."""
    assert light.sky is not None
    local = directions @ rotation(light)
    pixels = directions_of(ROWS, 2 * ROWS).reshape(-1, 3)
    nearest = np.argmax(pixels @ local.T, axis=1)
    weights = np.broadcast_to(solid_angles(ROWS, 2 * ROWS), (ROWS, 2 * ROWS)).reshape(-1, 1)
    light_of = _grid(light.sky.grid) * weights / math.pi
    cells = [np.bincount(nearest, light_of[:, c], len(directions)) for c in range(3)]
    found: F64 = np.stack(cells, axis=1) * np.array(light.radiance)
    return found


def _grid(grid: bytes) -> F64:
    """Return the pixels of a grid, shape (n, 3)."""
    return np.frombuffer(grid, np.float32).reshape(-1, 3).astype(np.float64)


def _limit(image: F64, angles: F64) -> float:
    """Return the luminance above which a pixel may be of a peak: a multiple of the mean of what is
    not above it."""
    luminance = image @ np.array(LUMINANCE)
    limit = float(luminance.max())
    for _ in range(ROUNDS):
        mean = float((np.minimum(luminance, limit) * angles).sum()) / (4.0 * math.pi)
        limit = min(limit, THRESHOLD * mean)
    return limit


def _take_peak(image: F64, angles: F64, directions: F64, limit: float) -> Peak | None:
    """Remove the strongest peak from an image and return it; None if no peak is strong.

    Args:
        limit: Luminance above which a pixel is of a peak; as much of it stays.
    """
    luminance = image @ np.array(LUMINANCE)
    whole = float((luminance * angles).sum())
    over = np.where(luminance > limit, 1.0 - limit / np.maximum(luminance, 1e-300), 0.0)
    strength = luminance * over * angles
    if not strength.any():
        return None
    # a single bright pixel is no peak where many of less light are one
    coarse = _sums(strength, min(ROWS, len(image)), min(2 * ROWS, image.shape[1]))
    row, column = np.unravel_index(np.argmax(coarse), coarse.shape)
    middle = directions_of(*coarse.shape)[row, column]
    inside = (over > 0) & (directions @ middle > math.cos(RADIUS))
    weights = strength[inside]
    if not weights.sum() >= LEAST * whole:
        return None
    centre = (weights[:, None] * directions[inside]).sum(axis=0)
    centre /= np.linalg.norm(centre)
    away = np.arccos(np.clip(directions[inside] @ centre, -1.0, 1.0))
    # the mean square of the distances in a disc is half the square of its radius
    spread = 2.0 * math.sqrt(2.0 * float((weights * away**2).sum() / weights.sum()))
    taken = image[inside] * over[inside][:, None]
    image[inside] -= taken
    part = np.broadcast_to(angles, luminance.shape)[inside]
    red, green, blue = ((taken * part[:, None]).sum(axis=0) / math.pi).tolist()
    x, y, z = centre.tolist()
    return Peak(
        direction=(x, y, z), irradiance=(red, green, blue),
        angle=max(spread, math.pi / image.shape[0]),
    )  # fmt: skip


def _reduced(image: F32 | F64, rows: int, columns: int) -> F64:
    """Return a latlong picture of another size with the same light: each pixel is the mean, by
    solid angle, of the part of the picture that it covers."""
    found = image.astype(np.float64)
    if len(found) != rows:
        cosines = np.cos(np.linspace(0.0, math.pi, len(found) + 1))
        found = _averaged(found, cosines, np.cos(np.linspace(0.0, math.pi, rows + 1)))
    if found.shape[1] != columns:
        edges = np.linspace(0.0, 1.0, found.shape[1] + 1)
        turned = _averaged(found.transpose(1, 0, 2), edges, np.linspace(0.0, 1.0, columns + 1))
        found = np.ascontiguousarray(turned.transpose(1, 0, 2))
    return found


def _averaged(values: F64, edges: F64, wanted: F64) -> F64:
    """Return the means of a function that is constant between edges between other edges."""
    sign = 1.0 if edges[-1] > edges[0] else -1.0
    widths = np.abs(np.diff(edges))[:, None, None]
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values * widths, axis=0)])
    at = np.interp(sign * wanted, sign * edges, np.arange(len(edges)))
    low = np.minimum(at.astype(int), len(values) - 1)
    part = (at - low)[:, None, None]
    reached = sums[low] + part * (values * widths)[low]
    means: F64 = np.diff(reached, axis=0) / np.abs(np.diff(wanted))[:, None, None]
    return means


def _sums(values: F64, rows: int, columns: int) -> F64:
    """Return the sums of the values of a picture that are in each pixel of a smaller one."""
    row = np.arange(len(values)) * rows // len(values)
    column = np.arange(values.shape[1]) * columns // values.shape[1]
    number = (row[:, None] * columns + column).ravel()
    found: F64 = np.zeros(rows * columns)
    np.add.at(found, number, values.ravel())
    return found.reshape(rows, columns)
