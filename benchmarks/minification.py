"""Measure how well captures, and levels made from them, are drawn from afar.

    python -m benchmarks.minification [--size WIDTHxHEIGHT] [CAPTURE ...]

At k times the framing distance a picture should look like the mean of what is seen close: the
classic picture at k times the resolution, averaged over k x k pixels in the display space, in which
splats are blended. Cells are dB against this mean over the pixels that it shows, the least of three
views around the capture, and the time of all views. "4x4" draws sixteen samples a pixel, with the
low-pass at their size.

A plain part is decimated as it is. Levels are made by `decimating.level`, each from the next finer
one, with the low-pass of the default pixel, of half and of twice its size; "peak 2" allows
opacities up to 2. The last row is the gain of the best level over the best of whole captures and
the plain quarter with one sample a pixel.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, DATA, looking_at, scene_of, view_of
from usdsplat import formats
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.interchange.decimating import FAR_LINES, decimate, framing_pixel, level
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.thinning.pairs import OPAQUE
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import RasterizeMode, View

SIZE = (320, 240)
DISTANCES = (1, 2, 4, 8, 16)
LARGEST = 5120
"""Largest width of a picture [pixel]; distances that need a larger one are left out."""
TURNS = (0.4, 2.5, 4.6)
"""Azimuths of the views [radian]."""
SAMPLES = 4
"""Samples of a pixel along an axis, of the supersampled pictures."""
VISIBLE = 1 / 255
"""Opacity from which on a pixel is seen."""
FINE = ("level 1/4", "level 1/16")
"""The levels of which the best counts."""


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

    def views(self, distance: float, scale: int, frame: tuple[int, int] = SIZE) -> Iterator[View]:
        """Yield the views from a multiple of the framing distance, at `scale` times a size."""
        size = (frame[0] * scale, frame[1] * scale)
        for turn in TURNS:
            matrix, k = looking_at(self.center, turn, distance * self.radius * 2.4, size)
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
    size: tuple[int, int] = SIZE,
) -> list[F32]:
    """Return one picture for each view, RGBA of a size, the mean of `scale` x `scale` samples."""
    settings = RenderSettings(sorting="zDepth", color_mode="display", rasterize_mode=mode)
    scene = scene_of(cloud)
    found = []
    for view in where.views(distance, scale, size):
        bands = renderer.render(scene, view, settings, ("color",))
        found.append(mean(np.concatenate([band.arrays["color"].copy() for band in bands]), scale))
    return found


def psnr(found: F32, expected: F32) -> float:
    """Return the peak signal-to-noise ratio [dB] of colours over the pixels that are seen."""
    seen = expected[..., 3] > VISIBLE
    error = found[seen][:, :3].astype(np.float64) - expected[seen][:, :3]
    return float(-10 * np.log10(np.mean(error**2)))


@dataclass(frozen=True, slots=True)
class Way:
    """Splats, and how they are drawn."""

    label: str
    cloud: SplatCloud
    mode: RasterizeMode
    scale: int
    is_peer: bool = False
    """Whether the gain of levels is measured against it."""


def decibels(
    renderer: Renderer,
    way: Way,
    where: Framing,
    truth: Mapping[int, Sequence[F32]],
    size: tuple[int, int] = SIZE,
) -> dict[int, float]:
    """Return the least PSNR of the views [dB] by distance.

    Args:
        truth: Right picture of each view by distance.
    """
    return {
        k: min(map(psnr, pictures(renderer, way.cloud, where, k, way.mode, way.scale, size), right))
        for k, right in truth.items()
    }


def said(quality: float) -> str:
    """Return dB as the cell of a table; the right picture itself has no number."""
    return f"{quality:.1f}" if np.isfinite(quality) else "–"


def chain(
    cloud: SplatCloud, pixel: float, peak: float, parts: Sequence[int]
) -> Iterator[tuple[int, SplatCloud]]:
    """Yield the levels with a part of the splats, each made from the one before."""
    some = cloud
    for part in parts:
        some = level(some, len(cloud) // part, pixel=pixel, peak=peak)
        pixel = 0.0
        yield part, some


def ways(cloud: SplatCloud) -> Iterator[Way]:
    """Yield the rows of a table."""
    yield Way("whole", cloud, "classic", 1, True)
    yield Way("whole", cloud, "antialiased", 1, True)
    yield Way("whole", cloud, "antialiased", SAMPLES)
    plain = decimate(cloud, len(cloud) // 4)
    yield Way("plain 1/4", plain, "classic", 1, True)
    yield Way("plain 1/4", plain, "antialiased", 1, True)
    yield Way("plain 1/4", plain, "antialiased", SAMPLES)
    pixel = framing_pixel(cloud, FAR_LINES)
    for label, size, peak in (
        ("", pixel, OPAQUE),
        (", peak 2", pixel, 2.0),
        (", half the pixel", pixel / 2, OPAQUE),
        (", twice the pixel", pixel * 2, OPAQUE),
    ):
        for part, some in chain(cloud, size, peak, (4, 16) if label else (4, 16, 64)):
            yield Way(f"level 1/{part}{label}", some, "antialiased", SAMPLES)
            if part == 4 and not label:
                for scale in (1, 2, 8):
                    yield Way(f"level 1/{part}", some, "antialiased", scale)


def asked(arguments: Sequence[str]) -> tuple[list[str], tuple[int, int]]:
    """Return the names and the size of pictures of a command line."""
    names = list(arguments)
    if names[:1] != ["--size"]:
        return names, SIZE
    width, height = names[1].split("x")
    return names[2:], (int(width), int(height))


def main(report: Report) -> None:
    """Print a table for each capture."""
    names, size = asked(report.arguments)
    renderer = Renderer(open_device())
    for name in names or CAPTURES:
        cloud = formats.read(DATA / "splats" / name).cloud
        where = Framing.of(cloud)
        table = Table(
            title=f"{name}: {len(cloud):,} splats, degree {cloud.sh_degree}, {size[0]}x{size[1]}",
            caption=f"dB · s of all views; pixel {framing_pixel(cloud, FAR_LINES):.3g}, "
            f"that of the picture at 1x {2 * where.radius / size[1]:.3g}",
        )
        distances = [k for k in DISTANCES if k * size[0] <= LARGEST]
        for column in ("splats", "mode", *(f"{distance}x" for distance in distances)):
            table.add_column(column)
        truth = {k: pictures(renderer, cloud, where, k, "classic", k, size) for k in distances}
        peers, levels = dict.fromkeys(distances, -np.inf), dict.fromkeys(distances, -np.inf)
        for way in ways(cloud):
            cells = []
            for k in distances:
                start = time.perf_counter()
                drawn = pictures(renderer, way.cloud, where, k, way.mode, way.scale, size)
                spent = time.perf_counter() - start
                least = min(map(psnr, drawn, truth[k]))
                cells.append(f"{least:.1f} · {spent:.2f}" if np.isfinite(least) else "–")
                best = peers if way.is_peer else levels
                if way.is_peer or (way.label in FINE and way.scale == SAMPLES):
                    best[k] = max(best[k], least)
                report.add(
                    scene=name,
                    way=f"{way.label} {way.mode} {way.scale}",
                    size=f"{size[0]}x{size[1]}",
                    splats=len(way.cloud),
                    distance=k,
                    db=least,
                    ms=1e3 * spent / len(drawn),
                )
            table.add_row(way.label, f"{way.mode} {way.scale}x{way.scale}", *cells)
        gains = [f"{levels[k] - peers[k]:+.1f}" if k > 1 else "–" for k in distances]
        table.add_row("best of the levels", "over best of the others", *gains)
        report.show(table, 160)


if __name__ == "__main__":
    with Report("minification", sys.argv[1:]) as report:
        main(report)
