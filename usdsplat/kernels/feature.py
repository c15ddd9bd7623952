"""Compute normals and depths of splats for AOVs that average them."""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import kernel
from .project import DEPTH

FEATURES = 12
NORMAL, ALBEDO, AXIS, EXPECTED = 0, 3, 6, 9
"""First columns of the paints of a splat: normal in camera space; colour without higher harmonics;
thinnest axis, on the side of the eye; planar depth of the centre, confidence of the normal, and
occlusion."""
DEPTH_SUM, CONFIDENCE_SUM, OCCLUSION_SUM = 0, 1, 2
"""Channels of the sums of EXPECTED."""


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def axis_of(q, s):
    """Return the thinnest axis of a splat in local space."""
    w, i, j, k = np.float64(q[0]), np.float64(q[1]), np.float64(q[2]), np.float64(q[3])
    if s[0] <= s[1] and s[0] <= s[2]:
        return 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j + w * k), 2.0 * (i * k - w * j)
    if s[1] <= s[2]:
        return 2.0 * (i * j - w * k), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k + w * i)
    return 2.0 * (i * k + w * j), 2.0 * (j * k - w * i), 1.0 - 2.0 * (i * i + j * j)


@scalar
def normal_of(m, inverse, position, ax, ay, az, is_parallel, is_turned):
    """Return a normal of a splat in USD's camera space: y up, z towards the viewer.

    Args:
        m, inverse: Local to camera, and the inverse of its 3x3 part.
        position: In local space.
        ax, ay, az: In local space; it is transformed as normals are.
        is_parallel: Whether rays are parallel.
        is_turned: Whether the normal is turned to the side of the eye.
    """
    x = inverse[0, 0] * ax + inverse[1, 0] * ay + inverse[2, 0] * az
    y = inverse[0, 1] * ax + inverse[1, 1] * ay + inverse[2, 1] * az
    z = inverse[0, 2] * ax + inverse[1, 2] * ay + inverse[2, 2] * az
    length = math.sqrt(x * x + y * y + z * z)
    if not is_turned:
        scale = 1.0 / length if length > 0.0 else 0.0
        return np.float32(x * scale), np.float32(-y * scale), np.float32(-z * scale)
    if is_parallel:
        scale = (-1.0 if z > 0.0 else 1.0) / length if length > 0.0 else 0.0
        return np.float32(x * scale), np.float32(-y * scale), np.float32(-z * scale)
    px, py, pz = np.float64(position[0]), np.float64(position[1]), np.float64(position[2])
    away = (
        x * (m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3])
        + y * (m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3])
        + z * (m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3])
    )
    scale = (-1.0 if away > 0.0 else 1.0) / length if length > 0.0 else 0.0
    return np.float32(x * scale), np.float32(-y * scale), np.float32(-z * scale)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="found", writes=("out",), team=True)
def features(
    item, lane, lanes, matrices, inverses, is_parallel, positions, rotations, scales, normals,
    facts, block, base, sources, found, records, out,
):  # fmt: skip
    """Write the normals and depths of the visible splats of all instances of one field.

    Args:
        matrices, inverses, positions, rotations, scales, block, base, sources, found: See
            `ray_hit.ray_hits`.
        is_parallel: Whether rays are parallel, as for an orthographic camera.
        normals: Normals of surfaces in local space, (n, 3) f32; 0 where a splat has none. Empty if
            no splat has one, or they are not needed. The thinnest axis then stands for the normal.
        facts: Confidence and occlusion, (n, 2) f32; empty likewise. Normals with confidence 0 are
            turned to the eye.
        records: Result of `project.project`.
        out: Receives FEATURES floats for each used slot; the albedo is not written.
    """
    blocks = (positions.shape[0] + block - 1) // block
    m, inverse = matrices[item // blocks], inverses[item // blocks]
    slot = base + item * block
    for at in range(slot + lane, slot + found[item], lanes):
        i = sources[at]
        ax, ay, az = axis_of(rotations[i], scales[i])
        x, y, z = normal_of(m, inverse, positions[i], ax, ay, az, is_parallel, True)
        out[at, AXIS], out[at, AXIS + 1], out[at, AXIS + 2] = x, y, z
        confidence, occlusion = np.float32(0), np.float32(0)
        if normals.shape[0] > 0:
            confidence, occlusion = facts[i, 0], facts[i, 1]
            ax, ay = np.float64(normals[i, 0]), np.float64(normals[i, 1])
            az = np.float64(normals[i, 2])
            if ax * ax + ay * ay + az * az > 0:
                is_turned = confidence <= 0
                x, y, z = normal_of(m, inverse, positions[i], ax, ay, az, is_parallel, is_turned)
        out[at, NORMAL], out[at, NORMAL + 1], out[at, NORMAL + 2] = x, y, z
        out[at, EXPECTED] = records[at, DEPTH]
        out[at, EXPECTED + 1], out[at, EXPECTED + 2] = confidence, occlusion


@kernel(over="order", writes=("out",))
def labels(k, order, first_slots, numbers, out):
    """Set out[k] to the number of the appearance that the splat of rank k belongs to.

    Args:
        order: Slots in order of depth. first_slots: First slot of each appearance, ascending.
        numbers: One number for each appearance, any dtype.
        out: Receives one number for each rank.
    """
    out[k] = numbers[np.searchsorted(first_slots, order[k], side="right") - 1]


@kernel(over="image", writes=("image", "out"), axes=2)
def unit(y, x, image, surface, left, out):
    """Normalise summed normals, including the normal of a surface behind the splats.

    Args:
        image: Sums and coverage, shape (h, w, 4) f32.
        surface: Normal of a surface, shape (h, w, 3) f32.
        left: Transmittance of the splats to the surface, (h, w) f32; empty without surfaces.
        out: Receives unit normals, 0 where nothing is visible, (h, w, 3) f32.
    """
    a, b, c = image[y, x, 0], image[y, x, 1], image[y, x, 2]
    if left.shape[0] > 0 and left[y, x] > np.float32(0):
        a += left[y, x] * surface[y, x, 0]
        b += left[y, x] * surface[y, x, 1]
        c += left[y, x] * surface[y, x, 2]
    length = np.float32(math.sqrt(a * a + b * b + c * c))
    scale = np.float32(1) / length if length > np.float32(0) else np.float32(0)
    out[y, x, 0], out[y, x, 1], out[y, x, 2] = a * scale, b * scale, c * scale


@kernel(over="image", writes=("image", "out"), axes=2)
def expected(y, x, image, left, depth, out):
    """Write the mean of all depths, including that of a surface behind the splats; +inf where
    nothing is visible.

    Args:
        image: Sums of depths, confidence and occlusion, and coverage, shape (h, w, 4) f32.
        left: See `unit`.
        depth: Depth of the surface, shape (h, w) f32.
        out: Receives planar depths [scene unit], (h, w) f32.
    """
    total, weight = image[y, x, 0], image[y, x, 3]
    if left.shape[0] > 0 and left[y, x] > np.float32(0):
        total += left[y, x] * depth[y, x]
        weight += left[y, x]
    out[y, x] = total / weight if weight > np.float32(0) else np.float32(np.inf)


@kernel(over="image", writes=("out",), axes=2)
def mean(y, x, image, channel, left, behind, out):
    """Write the mean of confidence or occlusion, including that of a surface behind the splats; 0
    where nothing is visible.

    Args:
        image, left: See `expected`.
        channel: CONFIDENCE_SUM or OCCLUSION_SUM.
        behind: Value of a surface.
        out: Receives means, (h, w) f32.
    """
    total, weight = image[y, x, channel], image[y, x, 3]
    if left.shape[0] > 0 and left[y, x] > np.float32(0):
        total += left[y, x] * behind
        weight += left[y, x]
    out[y, x] = total / weight if weight > np.float32(0) else np.float32(0)
