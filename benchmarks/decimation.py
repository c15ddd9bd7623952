"""Compare pictures of decimated captures, and measure the time of decimation.

    python -m benchmarks.decimation [PART] [CAPTURE ...]

PART of the splats [0..1] is kept, by default 0.25. Noise is measured against classic pictures of
all splats: near, through the reference cameras, or three views around a capture that has none; and
from afar, in these three views at four times the framing distance. Cells are the least of the views
near and afar [dB], and the time [s]. "far, antialiased" is the least of pictures from afar where
both are drawn antialiased, decimated without a low-pass.

Ours is compared with a random selection, with the most visible splats, and with splat-transform's
uniform and adaptive modes, if it is installed, see `benchmarks.peers`. Besides captures,
there are two clouds of very thin splats: a made one, and a capture whose splats are made thinner.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from rich.table import Table

from benchmarks.minification import Framing
from benchmarks.peers import SplatTransform, splat_transform
from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, DATA, scene_of, view_of
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.quaternion import from_matrix
from usdsplat.core.sh import rgb_to_dc
from usdsplat.interchange.decimating import decimate, framing_pixel
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

PART = 0.25
MILLION = 1_000_000
SETTINGS = RenderSettings(sorting="zDepth", color_mode="display")
FAR = 4
"""Distance of the far views, as a multiple of the framing one."""
NEAR_SIZE = (640, 480)

Pictures = tuple[list[F32], list[F32], list[F32]]
"""Near, far, and far drawn antialiased."""
Thinning = Callable[[SplatCloud, int], SplatCloud]


def at_random(cloud: SplatCloud, count: int) -> SplatCloud:
    """Select splats at random."""
    rows = np.random.default_rng(0).permutation(len(cloud))[:count]
    return edit.take(cloud, np.sort(rows))


def most_seen(cloud: SplatCloud, count: int) -> SplatCloud:
    """Select the splats with the largest opacity times area of the two longest axes."""
    longest = np.sort(cloud.scales, axis=1)[:, 1:].prod(axis=1)
    return edit.take(cloud, np.sort(np.argsort(-cloud.opacities * longest)[:count]))


def by_peer(tool: SplatTransform, option: str) -> Thinning:
    """Decimate with splat-transform. The time includes its start and reading and writing a .ply."""

    def thinned(cloud: SplatCloud, count: int) -> SplatCloud:
        with tempfile.TemporaryDirectory() as folder:
            source, target = Path(folder) / "all.ply", Path(folder) / "some.ply"
            formats.write(cloud, source)
            tool.convert(source, target, option, str(count))
            return formats.read(target).cloud

    return thinned


def for_classic(cloud: SplatCloud, count: int) -> SplatCloud:
    """Decimate as `usdsplat convert` does a classic capture."""
    return decimate(cloud, count, pixel=framing_pixel(cloud))


def thinner(cloud: SplatCloud) -> SplatCloud:
    """Return the capture with the shortest axes divided by ten, the middle ones by three."""
    order = np.argsort(cloud.scales, axis=1)
    ranked = np.take_along_axis(cloud.scales, order, axis=1) * np.float32([0.1, 0.35, 1.3])
    scales = np.empty_like(cloud.scales)
    np.put_along_axis(scales, order, ranked, axis=1)
    return replace(cloud, scales=scales)


def thin(count: int = 95_000) -> SplatCloud:
    """Return a made capture: very thin splats of degree 3 on a bumpy closed surface."""
    random = np.random.default_rng(7)
    axes = np.array([0.8, 1.0, 0.9])

    def height(points: F64) -> F64:
        """Return how far points are outside the surface, up to a factor."""
        radius = np.linalg.norm(points / axes, axis=1)
        x, y, z = (points / axes).T / radius
        bumps = 0.12 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.05 * np.sin(11 * z + 3 * x)
        return np.asarray(radius - 1 - bumps)

    points = random.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = (points - height(points * axes)[:, None] * points) * axes
    normals = np.stack([height(points + e) - height(points - e) for e in 1e-4 * np.eye(3)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along = np.cross(normals, random.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    size = 0.012 * np.exp(random.normal(0, 0.7, count))
    scales = np.stack(
        [
            size,
            size * np.exp(-np.abs(random.normal(1.2, 0.8, count))),
            size * 10 ** random.uniform(-3.5, -1.5, count),
        ],
        axis=1,
    )
    waves = [np.sin(14 * points + 1 + i).prod(axis=1) for i in range(3)]
    harmonics = random.normal(0, 0.03, (count, 16, 3))
    harmonics[:, 0] = rgb_to_dc(0.55 + 0.3 * np.stack(waves, axis=1))
    harmonics[:, 1:4] -= 0.1 * normals[:, [1, 2, 0], None]
    frames = np.stack([along, np.cross(normals, along), normals], axis=2)
    return SplatCloud(
        positions=points.astype(np.float32),
        scales=scales.astype(np.float32),
        rotations=from_matrix(frames).astype(np.float32),
        opacities=np.clip(random.beta(1.3, 1.1, count), 0.01, 0.995).astype(np.float32),
        sh=harmonics.astype(np.float32),
    )


def clouds(names: Sequence[str]) -> Iterator[tuple[str, SplatCloud]]:
    """Yield the captures, and the thin ones if no names are given."""
    for name in names or (*CAPTURES, "guitar.compressed.ply"):
        yield name, formats.read(DATA / "splats" / name).cloud
    if not names:
        yield "made, thin", thin()
        yield (
            "playbot, made thinner",
            thinner(formats.read(DATA / "splats" / "playbot_lod2.sog").cloud),
        )


def views(name: str) -> list[View]:
    """Return the reference cameras of a capture."""
    oracle = np.load(DATA / "oracle" / "images" / f"{Path(name).stem}.npz")
    size, k = (int(oracle["width"]), int(oracle["height"])), oracle["K"].astype(np.float64)
    return [view_of(view, k, size) for view in oracle["viewmats"]]


def picture(
    renderer: Renderer,
    cloud: SplatCloud,
    view: View,
    mode: Literal["classic", "antialiased"] = "classic",
) -> F32:
    """Return the colours of a picture, shape (h, w, 3)."""
    settings = replace(SETTINGS, rasterize_mode=mode)
    bands = renderer.render(scene_of(cloud), view, settings, ("color",))
    return np.concatenate([band.arrays["color"][..., :3].copy() for band in bands])


def psnr(found: F32, expected: F32) -> float:
    """Return the peak signal-to-noise ratio [dB] for a peak of 1."""
    return float(-10 * np.log10(np.mean((found.astype(np.float64) - expected) ** 2)))


def million() -> SplatCloud:
    """Return a million splats of degree 3: adjacent copies of a capture."""
    cloud = formats.read(DATA / "splats" / "pod.spz").cloud
    aside = np.array([float(np.ptp(cloud.positions[:, 0])), 0, 0], np.float32)
    copies = range(-(-MILLION // len(cloud)))
    beside = [replace(cloud, positions=cloud.positions + i * aside) for i in copies]
    return edit.take(edit.merge(beside), np.arange(MILLION))


@dataclass(frozen=True, slots=True, kw_only=True)
class Views:
    """Views of a capture, and classic and antialiased pictures of all its splats."""

    near: list[View]
    far: list[View]

    @classmethod
    def of(cls, name: str, cloud: SplatCloud) -> Views:
        """Return the reference cameras, or views around the capture, and views from afar."""
        around = Framing.of(cloud)
        known = (DATA / "oracle" / "images" / f"{Path(name).stem}.npz").exists()
        near = views(name) if known else list(around.views(1, 1, NEAR_SIZE))
        return cls(near=near, far=list(around.views(FAR, 1)))

    def pictures(self, renderer: Renderer, cloud: SplatCloud) -> Pictures:
        """Draw them."""
        return (
            [picture(renderer, cloud, view) for view in self.near],
            [picture(renderer, cloud, view) for view in self.far],
            [picture(renderer, cloud, view, "antialiased") for view in self.far],
        )


def noise(found: Pictures, expected: Pictures) -> list[float]:
    """Return the least of each list of pictures [dB]."""
    return [min(map(psnr, *lists)) for lists in zip(found, expected, strict=True)]


def main(report: Report) -> None:
    """Print all tables."""
    arguments = list(report.arguments)
    part = float(arguments.pop(0)) if arguments else PART
    ways: dict[str, Thinning] = {
        "random": at_random,
        "most seen": most_seen,
        "ours, classic": for_classic,
        "ours, antialiased": decimate,
    }
    if tool := splat_transform():
        for option in ("--decimate", "--decimate-adaptive"):
            ways[f"splat-transform {option}"] = by_peer(tool, option)
    renderer = Renderer(open_device())
    decimate(at_random(formats.read(DATA / "splats" / CAPTURES[0]).cloud, 1000), 500)  # compiles
    table = Table(
        title=f"{part:.0%} of the splats", caption="dB near · far · far, antialiased · s; the least"
    )
    table.add_column("capture")
    for way in ways:
        table.add_column(way, justify="right")
    for name, cloud in clouds(arguments):
        cameras = Views.of(name, cloud)
        whole = cameras.pictures(renderer, cloud)
        cells = []
        for way, thinned in ways.items():
            start = time.perf_counter()
            some = thinned(cloud, round(part * len(cloud)))
            spent = time.perf_counter() - start
            near, far, antialiased = noise(cameras.pictures(renderer, some), whole)
            cells.append(f"{near:.1f} · {far:.1f} · {antialiased:.1f} · {spent:.1f}")
            report.add(scene=name, way=way, splats=len(some), db=near, far=far, smooth=antialiased)
        table.add_row(f"{name} {len(cloud)} SH {cloud.sh_degree}", *cells)
    report.show(table, 200)
    if not arguments:
        report.say(speed(million(), part))


def speed(cloud: SplatCloud, part: float) -> str:
    """Return the time of decimation, in words."""
    start, busy = time.perf_counter(), time.process_time()
    some = decimate(cloud, round(part * len(cloud)))
    spent, busy = time.perf_counter() - start, time.process_time() - busy
    return (
        f"{len(cloud)} splats, SH {cloud.sh_degree}, to {len(some)}: {spent:.1f} s "
        f"({busy:.1f} s of cores)"
    )


if __name__ == "__main__":
    with Report("decimation", sys.argv[1:]) as report:
        main(report)
