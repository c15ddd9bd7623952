"""Measure how smooth the normals of captures are, how long they take, and those of known shapes.

    python -m benchmarks.normals [CAPTURE ...]

Angles are those between the normal of a splat and the normals of its six nearest neighbours
[degree], of splats with an opacity above 0.3. "Thin axis" is the same for the shortest axes of the
splats, of either sign. Shapes are those of the tests, with errors against their closed forms.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, DATA
from tests.kernels.points import splat_shapes
from usdsplat import formats
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.sh import dc_to_rgb
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.normals.axes import thin_axes
from usdsplat.kernels.points.nearest import nearest
from usdsplat.kernels.points.surface_normals import surface_normals

VISIBLE = 0.3
"""Opacity above which a splat counts."""
AROUND = 6
"""Number of neighbours."""


def angles(device: Device, cloud: SplatCloud, normals: F32, *, signed: bool) -> F64:
    """Return the angles to the normals of the nearest neighbours [degree], flat."""
    rows, _ = nearest(device, cloud.positions, cloud.positions, AROUND + 1)
    shown = cloud.opacities > VISIBLE
    cosines = np.einsum("ikj,ij->ik", normals[rows[shown, 1:]], normals[shown]).ravel()
    if not signed:
        cosines = np.abs(cosines)
    found: F64 = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return found


def captures(device: Device, names: Sequence[str], report: Report) -> None:
    """Measure captures."""
    table = Table(title="normals of captures: angles to the six nearest neighbours [degree]")
    table.add_column("capture")
    for column in (
        "splats", "ms", "median", "90 %", "99 %", "thin axis, median", "90 %", "confidence",
        "occlusion",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for name in names:
        cloud = formats.read(DATA / "splats" / name).cloud
        colors = dc_to_rgb(cloud.sh[:, 0])
        times = []
        for _ in range(3):
            start = time.perf_counter()
            found = surface_normals(
                device, cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, colors
            )
            times.append(1000 * (time.perf_counter() - start))
        axes = np.empty((len(cloud), 3), np.float32)
        device.run(thin_axes, cloud.rotations, cloud.scales, axes)
        ours = np.quantile(angles(device, cloud, found.normals, signed=True), (0.5, 0.9, 0.99))
        thin = np.quantile(angles(device, cloud, axes, signed=False), (0.5, 0.9))
        table.add_row(
            name, f"{len(cloud):,}", f"{np.median(times):.0f}", *(f"{each:.1f}" for each in ours),
            *(f"{each:.0f}" for each in thin), f"{np.median(found.confidence):.2f}",
            f"{np.median(found.occlusion):.2f}",
        )  # fmt: skip
        report.add(device=device.name, scene=name, splats=len(cloud), ms=float(np.median(times)))
    report.show(table, 170)


def shapes(device: Device, report: Report) -> None:
    """Measure shapes with known normals."""
    table = Table(title="normals of shapes: errors [degree]")
    table.add_column("shape")
    for column in ("splats", "mean", "99 %", "max", "inwards"):
        table.add_column(column, justify="right")
    cases = {
        "sphere": splat_shapes.sphere(20_000),
        "torus 1 : 0.35": splat_shapes.torus(20_000),
        "cube, beyond two spacings from an edge": splat_shapes.cube(58),
    }
    for name, shape in cases.items():
        errors = shape.errors(shape.found(device))
        inwards = int(np.count_nonzero(errors > 90))
        if name.startswith("cube"):
            to_edge = np.sort(1 - np.abs(shape.positions), axis=1)[:, 1]
            errors = errors[to_edge > 2 * shape.spacing]
        table.add_row(
            name, f"{len(shape.positions):,}", f"{errors.mean():.1f}",
            f"{np.quantile(errors, 0.99):.1f}", f"{errors.max():.1f}", str(inwards),
        )  # fmt: skip
    report.show(table)


def main(report: Report) -> None:
    """Measure and print."""
    device = open_device("cpu")
    names = report.arguments or [*CAPTURES, "statue_massa.sog", "statue_trumpet.sog"]
    captures(device, names, report)
    shapes(device, report)


if __name__ == "__main__":
    with Report("normals", sys.argv[1:]) as report:
        main(report)
