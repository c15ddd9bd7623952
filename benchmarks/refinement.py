"""Compare pictures of refined captures with those of the captures, and measure the time.

    python -m benchmarks.refinement [SHARE] [CAPTURE ...]

Every splat longer than a limit is divided until none is. The limit is the largest for which the
splats that are divided make up SHARE of what four pictures show, by default 0.3. The pictures are
taken as `usdsplat render` frames a capture, a quarter turn apart, at 1280x720. Cells are the least
and the largest of the four [dB, over the whole picture].

Where splats are sorted by the depth of their centre, children are sorted by theirs, so that large
splats that lie in one another change places in parts; sorted along each ray they do not. No
constant was chosen on the captures below the line.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from rich.table import Table

from benchmarks.decimation import million
from benchmarks.memory import resident
from benchmarks.report import Report
from benchmarks.scenes import DATA, scene_of
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.sh import rgb_to_dc
from usdsplat.delegate.default_camera import frame_subject
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing, RasterizeMode, View
from usdsplat.render.subject import of_box
from usdsplat.sim.carriers import expected_spacing
from usdsplat.sim.refining import FAINT, refined

SHARE = 0.3
SIZE = (1280, 720)
TUNED = ("statue_angel.sog", "playbot_lod2.sog", "pod.spz", "flowers_lod2_0.sog")
HELD_OUT = ("statue_massa.sog", "guitar.compressed.ply")
UPRIGHT = np.diag([1.0, -1.0, -1.0, 1.0])
"""From the captures' axes, y down, to y up."""
STEPS = 14
"""Halvings of the interval in which the limit is."""
MILLION_LIMIT = 1.2
"""Limit for a million splats, in spacings."""

Sorting = Literal["zDepth", "rayHitDistance"]
WAYS: tuple[tuple[RasterizeMode, Sorting], ...] = (
    ("classic", "zDepth"), ("antialiased", "zDepth"),
    ("classic", "rayHitDistance"), ("antialiased", "rayHitDistance"),
)  # fmt: skip


AROUND = 1.1
"""Size of what is framed, relative to the capture."""


def views(cloud: SplatCloud, size: tuple[int, int] = SIZE) -> Iterator[View]:
    """Yield four views around a capture, y up, each of which shows all of it."""
    box = scene_of(cloud).subject()
    assert box is not None
    middle, half = 0.5 * (box[0] + box[1]), AROUND * 0.5 * (box[1] - box[0])
    around = of_box((middle - half, middle + half))
    camera = frame_subject(around, box, up_axis="Y", aspect=size[0] / size[1])
    near, far = camera.clipping_range
    there, back = np.eye(4), np.eye(4)
    there[:3, 3], back[:3, 3] = middle, -middle
    for quarter in range(4):
        turn = np.eye(4)
        cosine, sine = math.cos(quarter * math.pi / 2), math.sin(quarter * math.pi / 2)
        turn[0, 0], turn[0, 2], turn[2, 0], turn[2, 2] = cosine, sine, -sine, cosine
        matrix = np.array(camera.world_to_camera).reshape(4, 4) @ there @ turn @ back
        turned = replace(
            camera, world_to_camera=tuple(matrix.ravel().tolist()),
            clipping_range=(0.01 * near, 10 * far),
        )  # fmt: skip
        yield View(camera=turned, framing=Framing(resolution=size))


@dataclass(frozen=True, slots=True)
class Gallery:
    """Pictures of one capture."""

    renderer: Renderer
    views: Sequence[View]

    def drawn(
        self, cloud: SplatCloud, mode: RasterizeMode = "classic", sorting: Sorting = "zDepth"
    ) -> list[F32]:
        """Return RGBA from each view."""
        settings = RenderSettings(sorting=sorting, color_mode="display", rasterize_mode=mode)
        scene = scene_of(cloud)
        return [
            np.concatenate(
                [
                    band.arrays["color"].copy()
                    for band in self.renderer.render(scene, view, settings, ("color",))
                ]
            )
            for view in self.views
        ]

    def share(self, cloud: SplatCloud, limit: float) -> float:
        """Return the part of the pictures that splats above a limit make up."""
        is_divided = (cloud.scales.max(axis=1) > limit) & (cloud.opacities >= FAINT)
        sh = np.zeros((len(cloud), 1, 3), np.float32)
        sh[:, 0] = rgb_to_dc(np.repeat(is_divided[:, None], 3, axis=1).astype(np.float32))
        found = self.drawn(replace(cloud, sh=sh))
        shown = [float(each[..., 0].sum() / max(each[..., 3].sum(), 1e-9)) for each in found]
        return float(np.mean(shown))

    def limit(self, cloud: SplatCloud, share: float) -> float:
        """Return the largest standard deviation above which splats make up a share of the
        pictures [unit]."""
        sizes = cloud.scales.max(axis=1)
        low, high = math.log(float(np.percentile(sizes, 20))), math.log(float(sizes.max()))
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            if self.share(cloud, math.exp(middle)) >= share:
                low = middle
            else:
                high = middle
        return math.exp(low)


def psnr(found: F32, expected: F32) -> float:
    """Return the peak signal-to-noise ratio of colours over the whole picture [dB]."""
    error = found[..., :3].astype(np.float64) - expected[..., :3]
    return float(-10 * np.log10(max(float(np.mean(error**2)), 1e-12)))


def main(report: Report) -> None:
    """Print the table, and the time for a million splats."""
    arguments = list(report.arguments)
    share = SHARE
    if arguments and arguments[0].replace(".", "").isdigit():
        share = float(arguments.pop(0))
    device = open_device()
    renderer = Renderer(device)
    table = Table(title=f"pictures of refined captures, at least {share:.0%} of what is seen")
    for column in ("capture", "splats", "refined", "limit", "share"):
        table.add_column(column, justify="left" if column == "capture" else "right")
    for mode, sorting in WAYS:
        table.add_column(f"{mode}, {sorting}", justify="right")
    for name in arguments or (*TUNED, *HELD_OUT):
        cloud = edit.transform(formats.read(DATA / "splats" / name).cloud, UPRIGHT)
        gallery = Gallery(renderer, list(views(cloud)))
        limit = gallery.limit(cloud, share)
        some, _ = refined(device, cloud, limit=limit, budget=100 * len(cloud))
        shown = gallery.share(cloud, limit)
        spacings = limit / expected_spacing(device, cloud)
        cells = []
        for mode, sorting in WAYS:
            pairs = zip(
                gallery.drawn(some, mode, sorting), gallery.drawn(cloud, mode, sorting),
                strict=True,
            )  # fmt: skip
            decibels = [psnr(*pair) for pair in pairs]
            cells.append(f"{min(decibels):.1f}-{max(decibels):.1f}")
            report.add(
                scene=name, way=f"{mode} {sorting}", splats=len(some), share=shown, db=decibels
            )
        if not arguments and name == HELD_OUT[0]:
            table.add_section()
        table.add_row(
            name, f"{len(cloud):,}", f"{len(some):,}", f"{spacings:.1f} spacings", f"{shown:.2f}",
            *cells,
        )  # fmt: skip
    report.show(table, 170)
    if not arguments:
        report.say(speed(million()))


def speed(cloud: SplatCloud) -> str:
    """Return the time of a refinement, in words."""
    device = open_device()
    begin = time.perf_counter()
    limit = MILLION_LIMIT * expected_spacing(device, cloud)
    asked = time.perf_counter() - begin
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak
    before, begin = resident("VmRSS"), time.perf_counter()
    some, _ = refined(device, cloud, limit=limit)
    spent = time.perf_counter() - begin
    more = resident("VmHWM") - before
    own = sum(array.nbytes for array in (some.positions, some.scales, some.rotations, some.sh))
    return (
        f"{len(cloud):,} splats, SH {cloud.sh_degree}, to {len(some):,} at a limit of "
        f"{MILLION_LIMIT:g} spacings: {asked:.1f} s for the spacing, {spent:.1f} s to divide, "
        f"{more:,.0f} MiB more at the peak, of which the result has {own / 2**20:,.0f}"
    )


if __name__ == "__main__":
    with Report("refinement", sys.argv[1:]) as report:
        main(report)
