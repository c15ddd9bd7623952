"""Measure how well captures, and levels made from them, are drawn from afar.

    python -m benchmarks.minification [CAPTURE ...]

At k times the framing distance a picture should look like the mean of what is seen close: the
classic picture at k times the resolution, averaged over k x k pixels in the display space, in which
splats are blended. Cells are dB against this mean over the pixels that it shows, the least of three
views around the capture. "4x4" draws sixteen samples a pixel, with the low-pass at their size.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, DATA, scene_of, view_of
from usdsplat import formats
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.interchange.decimating import decimate
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import RasterizeMode, View

SIZE = (320, 240)
DISTANCES = (1, 2, 4, 8)
TURNS = (0.4, 2.5, 4.6)
"""Azimuths of the views [radian]."""
SAMPLES = 4
"""Samples of a pixel along an axis, of the supersampled pictures."""
WAYS: tuple[tuple[RasterizeMode, int], ...] = (
    ("classic", 1), ("antialiased", 1), ("antialiased", SAMPLES),
)  # fmt: skip
"""Rasterize mode, and samples of a pixel along an axis."""
VISIBLE = 1 / 255
"""Opacity from which on a pixel is seen."""


@dataclass(frozen=True, slots=True)
class Framing:
    """Sphere around most of a capture's weight."""

    center: F64
    radius: float

    @classmethod
    def of(cls, cloud: SplatCloud) -> Framing:
        """Return the sphere around the weighted middle that holds 95 % of opacity times area."""
        area = np.sort(cloud.scales, axis=1)[:, 1:].prod(axis=1)
        weight = cloud.opacities * np.minimum(area, np.quantile(area, 0.99))
        points = cloud.positions.astype(np.float64)
        center = np.average(points, axis=0, weights=weight)
        reach = np.linalg.norm(points - center, axis=1)
        order = np.argsort(reach)
        share = np.cumsum(weight[order]) / weight.sum()
        return cls(center, float(reach[order][np.searchsorted(share, 0.95)]))

    def views(self, distance: float, scale: int) -> Iterator[View]:
        """Yield the views from a multiple of the framing distance, at `scale` times SIZE."""
        size = (SIZE[0] * scale, SIZE[1] * scale)
        focal = 1.2 * size[1]
        away = distance * self.radius * 2 * 1.2
        k = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
        for turn in TURNS:
            back = np.array([np.sin(turn), -0.25, np.cos(turn)])
            back /= np.linalg.norm(back)
            right = np.cross([0, -1.0, 0], back)
            right /= np.linalg.norm(right)
            axes = np.array([right, np.cross(-back, right), -back])
            matrix = np.eye(4)
            matrix[:3, :3] = axes
            matrix[:3, 3] = -axes @ (self.center + back * away)
            yield view_of(matrix, k, size)


def mean(picture: F32, scale: int) -> F32:
    """Return the mean over squares of `scale` pixels."""
    h, w, n = picture.shape
    return picture.reshape(h // scale, scale, w // scale, scale, n).mean(axis=(1, 3))


def pictures(
    renderer: Renderer,
    cloud: SplatCloud,
    where: Framing,
    distance: int,
    mode: RasterizeMode,
    scale: int,
) -> list[F32]:
    """Return one picture for each view, RGBA at SIZE, the mean of `scale` x `scale` samples."""
    settings = RenderSettings(sorting="zDepth", color_mode="display", rasterize_mode=mode)
    scene = scene_of(cloud)
    found = []
    for view in where.views(distance, scale):
        bands = renderer.render(scene, view, settings, ("color",))
        found.append(mean(np.concatenate([band.arrays["color"].copy() for band in bands]), scale))
    return found


def psnr(found: F32, expected: F32) -> float:
    """Return the peak signal-to-noise ratio [dB] of colours over the pixels that are seen."""
    seen = expected[..., 3] > VISIBLE
    error = found[seen][:, :3].astype(np.float64) - expected[seen][:, :3]
    return float(-10 * np.log10(np.mean(error**2)))


def main(report: Report) -> None:
    """Print a table for each capture."""
    renderer = Renderer(open_device())
    for name in report.arguments or CAPTURES:
        cloud = formats.read(DATA / "splats" / name).cloud
        where = Framing.of(cloud)
        levels = {"whole": cloud}
        for part in (4, 16, 64):
            levels[f"1/{part}"] = decimate(list(levels.values())[-1], len(cloud) // part)
        table = Table(title=f"{name}: {len(cloud):,} splats, degree {cloud.sh_degree}")
        for column in ("splats", "mode", *(f"{distance}x" for distance in DISTANCES)):
            table.add_column(column)
        truth = {k: pictures(renderer, cloud, where, k, "classic", k) for k in DISTANCES}
        for label, level in levels.items():
            for mode, scale in WAYS:
                cells = []
                for k in DISTANCES:
                    drawn = pictures(renderer, level, where, k, mode, scale)
                    least = min(map(psnr, drawn, truth[k]))
                    cells.append(f"{least:.1f}" if np.isfinite(least) else "–")
                    report.add(scene=name, way=f"{label} {mode} {scale}", distance=k, db=least)
                table.add_row(label, f"{mode} {scale}x{scale}", *cells)
        report.show(table)


if __name__ == "__main__":
    with Report("minification", sys.argv[1:]) as report:
        main(report)
