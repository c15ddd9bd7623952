"""Apply the stack of deformers: displace splats at rest, and compute the deformation gradient.

Each deformer acts in its own space, along one of its axes. In coordinates (p, q, s), s along the
axis and p, q along the next two in the order X Y Z X Y:

- transform: scales, rotates about X, Y, Z, translates; the axis does not matter.
- bend: bends the axis from 0 to the length into an arc of the same length, towards p.
- twist: rotates about the axis, from 0 to the angle over the length.
- taper: scales across the axis, from 1 to `scale` over the length.
- lattice: follows control points of the unit cube by Bernstein polynomials; points outside move
  with the nearest point of the cube. The axis does not matter.
- noise: displaces by three noises; curl: by a noise that preserves volume. Both move along s.
- wave: displaces along s by a sine that runs along p.

Beyond their length, bend, twist and taper continue as they are at its end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import UsageError
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import deform as closed
from usdsplat.kernels.sim import deform_lattice, deform_noise
from usdsplat.sim.parameters import DeformParameters
from usdsplat.sim.specs import Deformer

NO_GRADIENT = np.empty((0, 3, 3), np.float32)
NO_MASK = np.empty(0, np.float32)


def deform(
    device: Device,
    deformers: Sequence[Deformer],
    seconds: float,
    positions: F32,
    gradient: F32 | None = None,
) -> None:
    """Displace splats by all deformers, one after the other.

    With weight w a deformer f moves x to x + w (f(x) - x). Where w is 0, positions do not change.

    Args:
        deformers: In the order of the stack.
        seconds: Time since the simulation's start [s], for noise, curl and wave.
        positions: [unit], replaced, shape (n, 3).
        gradient: F of each splat, replaced by J F with J of the whole stack, shape (n, 3, 3); None
            skips it. J contains the gradient of a falloff, but not of a mask.

    Raises:
        UsageError: If a frame has no inverse, a mask does not have n rows, or a lattice does not
            have as many points as its divisions say.
    """
    out = NO_GRADIENT if gradient is None else gradient
    for deformer in deformers:
        p, mask = deformer.parameters, NO_MASK if deformer.mask is None else deformer.mask
        if deformer.mask is not None and len(mask) != len(positions):
            raise UsageError(
                f"{deformer.name}.mask", f"{len(mask)} values", f"{len(positions)}, one per splat"
            )
        if p.weight == 0:
            continue
        last = (_space(deformer), float(p.weight), float(p.falloff), mask, positions, out)
        if p.type == "lattice":
            factors = _lattice(deformer)
            if factors is not None:
                device.run(deform_lattice.lattice, factors, *last)
        elif p.type in ("noise", "curl"):
            kernel = deform_noise.noise if p.type == "noise" else deform_noise.curl
            shift, seed = float(p.speed * seconds), np.uint32(p.seed)
            device.run(kernel, float(p.amount), float(p.size), shift, seed, *last)
        else:
            kind, numbers = _closed_form(p, seconds)
            device.run(closed.deform, kind, np.array(numbers, np.float64), *last)


def _order(p: DeformParameters) -> list[int]:
    """Return the axes of p, q and s."""
    if p.type in ("transform", "lattice"):
        return [0, 1, 2]
    axis = "XYZ".index(p.axis)
    return [(axis + 1) % 3, (axis + 2) % 3, axis]


def _space(deformer: Deformer) -> F64:
    """Return the matrices to (p, q, s) and back, shape (2, 3, 4)."""
    back = np.asarray(deformer.frame, np.float64)
    if not np.isfinite(back).all() or abs(np.linalg.det(back[:3, :3])) < 1e-30:
        raise UsageError(f"{deformer.name}.frame", "a singular matrix", "an invertible one")
    order = _order(deformer.parameters)
    out = np.empty((2, 3, 4))
    out[0] = np.linalg.inv(back)[order]
    out[1] = back[:3][:, [*order, 3]]
    return out


def _closed_form(p: DeformParameters, seconds: float) -> tuple[int, tuple[Any, ...]]:
    """Return the kind and the numbers of a deformer, as the kernel reads them."""
    angle = math.radians(p.angle)
    if p.type == "bend":
        return closed.BEND, (p.length, angle)
    if p.type == "twist":
        return closed.TWIST, (p.length, angle)
    if p.type == "taper":
        first, second, _ = _order(p)
        return closed.TAPER, (p.length, p.scale[first] - 1, p.scale[second] - 1)
    if p.type == "wave":
        number = math.tau / p.size
        return closed.WAVE, (p.amount, number, math.tau * math.fmod(p.speed * seconds, 1))
    x, y, z = (_turn(axis, math.radians(angle)) for axis, angle in enumerate(p.rotate))
    whole = z @ y @ x @ np.diag(p.scale)
    return closed.TRANSFORM, (*(whole - np.eye(3)).ravel(), *p.translate)


def _turn(axis: int, angle: float) -> F64:
    """Return the rotation about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = math.cos(angle)
    out[j, i], out[i, j] = math.sin(angle), -math.sin(angle)
    return out


def _lattice(deformer: Deformer) -> F64 | None:
    """Return the power-basis factors of the displacement, shape (nz, ny, nx, 3); None without
    points."""
    p = deformer.parameters
    if not p.points:
        return None
    nx, ny, nz = p.divisions
    if len(p.points) != nx * ny * nz:
        raise UsageError(
            f"{deformer.name}.points",
            f"{len(p.points)} points",
            f"{nx * ny * nz}, for divisions {nx} x {ny} x {nz}",
        )
    points = np.array(p.points, np.float64).reshape(nz, ny, nx, 3)
    axes = (np.linspace(0, 1, k) for k in (nz, ny, nx))
    z, y, x = np.meshgrid(*axes, indexing="ij")
    displacement = points - np.stack([x, y, z], axis=3)
    powers = np.einsum(
        "kc,jb,ia,cbad->kjid", _powers(nz), _powers(ny), _powers(nx), displacement, optimize=True
    )
    return np.ascontiguousarray(powers)


def _powers(count: int) -> F64:
    """Return the matrix from `count` Bernstein factors to factors of powers of t."""
    n = count - 1
    out = np.zeros((count, count))
    for i in range(count):
        for k in range(i + 1):
            out[i, k] = math.comb(n, i) * math.comb(i, k) * (-1) ** (i - k)
    return out
