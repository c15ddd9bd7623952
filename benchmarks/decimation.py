"""Compare pictures of decimated captures, and measure the time of decimation.

    python -m benchmarks.decimation [PART] [SPLAT_TRANSFORM]

PART of the splats [0..1] is kept, by default 0.25. Pictures are those of the reference cameras;
noise is measured against a picture of all splats. Ours is compared with a random selection, with
the most visible splats, and with splat-transform's uniform and adaptive modes, if the path of its
`cli.mjs` is given (`npm install @playcanvas/splat-transform`; needs node 22).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, DATA, scene_of, view_of
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.interchange.decimating import decimate
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

PART = 0.25
MILLION = 1_000_000
SETTINGS = RenderSettings(sorting="zDepth", color_mode="display")

Thinning = Callable[[SplatCloud, int], SplatCloud]


def at_random(cloud: SplatCloud, count: int) -> SplatCloud:
    """Select splats at random."""
    rows = np.random.default_rng(0).permutation(len(cloud))[:count]
    return edit.take(cloud, np.sort(rows))


def most_seen(cloud: SplatCloud, count: int) -> SplatCloud:
    """Select the splats with the largest opacity times area of the two longest axes."""
    longest = np.sort(cloud.scales, axis=1)[:, 1:].prod(axis=1)
    return edit.take(cloud, np.sort(np.argsort(-cloud.opacities * longest)[:count]))


def by_peer(tool: Path, option: str) -> Thinning:
    """Decimate with splat-transform. The time includes its start and reading and writing a .ply."""

    def thinned(cloud: SplatCloud, count: int) -> SplatCloud:
        with tempfile.TemporaryDirectory() as folder:
            source, target = Path(folder) / "all.ply", Path(folder) / "some.ply"
            formats.write(cloud, source)
            command = ["node", tool, "-w", "-g", "cpu", source, option, str(count), target]
            subprocess.run(command, check=True, capture_output=True)
            return formats.read(target).cloud

    return thinned


def views(name: str) -> list[View]:
    """Return the reference cameras of a capture."""
    oracle = np.load(DATA / "oracle" / "images" / f"{Path(name).stem}.npz")
    size, k = (int(oracle["width"]), int(oracle["height"])), oracle["K"].astype(np.float64)
    return [view_of(view, k, size) for view in oracle["viewmats"]]


def picture(renderer: Renderer, cloud: SplatCloud, view: View) -> F32:
    """Return the colours of a picture, shape (h, w, 3)."""
    bands = renderer.render(scene_of(cloud), view, SETTINGS, ("color",))
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


def main(report: Report) -> None:
    """Print all tables."""
    arguments = report.arguments
    part = float(arguments[0]) if arguments else PART
    ways: dict[str, Thinning] = {"random": at_random, "most seen": most_seen, "ours": decimate}
    if len(arguments) > 1:
        for option in ("--decimate", "--decimate-adaptive"):
            ways[f"splat-transform {option}"] = by_peer(Path(arguments[1]), option)
    renderer = Renderer(open_device())
    decimate(at_random(formats.read(DATA / "splats" / CAPTURES[0]).cloud, 1000), 500)  # compiles
    table = Table(title=f"{part:.0%} of the splats", caption="dB in each view · over random · s")
    table.add_column("capture")
    for way in ways:
        table.add_column(way, justify="right")
    for name in CAPTURES:
        cloud = formats.read(DATA / "splats" / name).cloud
        cameras = views(name)
        whole = [picture(renderer, cloud, view) for view in cameras]
        cells, chance = [], 0.0
        for way, thin in ways.items():
            start = time.perf_counter()
            some = thin(cloud, round(part * len(cloud)))
            spent = time.perf_counter() - start
            noise = [
                psnr(picture(renderer, some, view), expected)
                for view, expected in zip(cameras, whole, strict=True)
            ]
            chance = float(np.mean(noise)) if way == "random" else chance
            each = " ".join(f"{ratio:.1f}" for ratio in noise)
            cells.append(f"{each} · {np.mean(noise) - chance:+.1f} · {spent:.1f}")
        table.add_row(f"{name} {len(cloud)} SH {cloud.sh_degree}", *cells)
    cloud = million()
    start, busy = time.perf_counter(), time.process_time()
    some = decimate(cloud, round(part * MILLION))
    spent, busy = time.perf_counter() - start, time.process_time() - busy
    report.show(table, 160)
    report.say(f"{MILLION} splats, SH 3, to {len(some)}: {spent:.1f} s ({busy:.1f} s of cores)")


if __name__ == "__main__":
    with Report("decimation", sys.argv[1:]) as report:
        main(report)
