"""Measure levels of Spark's trees beside ours with as many splats, from afar.

    python -m benchmarks.spark_levels [--size WIDTHxHEIGHT] [CAPTURE ...]

The measure is that of `benchmarks.minification`: dB against the mean of the classic picture of the
whole capture at k times the resolution, in the display space, the least of three views. Captures
have no harmonics, so that only geometry and opacity matter. "ours" are the levels of a tree of
`usdsplat lod`; "quick" and "quality" are the cuts of as many splats that Spark chooses from afar,
of the trees of its two methods. All are drawn by our renderer, antialiased, as both programs draw
them, with one and with 4x4 samples a pixel.

Spark's merged splats may have opacities above 1, which it draws flat-topped, 1 - (1 - g)^a for the
Gaussian g: here as a stack of opaque splats and one for the rest of a. "no stack" is its option
`lodInflate` instead: one splat, larger by the third root of a.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pxr import Usd
from rich.table import Table

from benchmarks import peers
from benchmarks.minification import (
    DISTANCES,
    LARGEST,
    SAMPLES,
    Framing,
    Way,
    asked,
    decibels,
    pictures,
    said,
)
from benchmarks.report import Report
from benchmarks.scenes import DATA
from usdsplat import formats
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.edit import with_sh_degree
from usdsplat.core.sh import rgb_to_dc
from usdsplat.interchange.lod import build_tree
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.schema.tree_cuts import TreeReading

LEVELS = (1, 2, 3)
METHODS = ("quick", "quality")
FLATTEST = 5.0
"""Largest value of the opacity that Spark stretches from 1..2."""


def decoded(ext0: np.ndarray, ext1: np.ndarray) -> tuple[SplatCloud, F32]:
    """Return the splats of Spark's arrays, and their opacities, which may be above 1.

    Source: `decodeExtSplat` and `decodeQuatOctXy1010R12` of Spark 2.2.

    Args:
        ext0, ext1: uint32 arrays, shape (n, 4).
    """

    def half(words: np.ndarray) -> F32:
        return (words & 0xFFFF).astype(np.uint16).view(np.float16).astype(np.float32)

    colors = np.stack([half(ext1[:, 0]), half(ext1[:, 0] >> 16), half(ext1[:, 1])], axis=1)
    sizes = np.stack([half(ext1[:, 1] >> 16), half(ext1[:, 2]), half(ext1[:, 2] >> 16)], axis=1)
    turns = ext1[:, 3]
    x, y = 2 * (turns & 1023) / 1023 - 1, 2 * (turns >> 10 & 1023) / 1023 - 1
    z = 1 - np.abs(x) - np.abs(y)
    folded = np.maximum(-z, 0)
    axes = np.stack([x - np.copysign(folded, x), y - np.copysign(folded, y), z], axis=1)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = (turns >> 20)[:, None] / 4095 * np.pi / 2
    opacities = half(ext0[:, 3])
    cloud = SplatCloud(
        positions=np.ascontiguousarray(ext0[:, :3]).view(np.float32),
        scales=np.exp(sizes),
        rotations=np.hstack([np.cos(angles), axes * np.sin(angles)]).astype(np.float32),
        opacities=np.minimum(opacities, 1),
        sh=rgb_to_dc(colors).astype(np.float32)[:, None],
    )
    return cloud, opacities


def drawable(cloud: SplatCloud, opacities: F32, *, stacked: bool) -> SplatCloud:
    """Return splats with opacities of at most 1 that look like those of Spark."""
    stretched = np.minimum(4 * opacities - 3, FLATTEST)
    flat = np.where(opacities > 1, np.exp((stretched**2 - 1) / np.e), 1.0)
    copies = np.ceil(flat).astype(int) if stacked else np.ones(len(cloud), int)
    rows = np.repeat(np.arange(len(cloud)), copies)
    above = np.arange(len(rows)) - np.repeat(np.cumsum(copies) - copies, copies)
    part = np.clip(flat[rows] - above, 0, 1) if stacked else np.ones(len(rows))
    growth = np.ones(len(rows)) if stacked else np.cbrt(flat[rows])
    return SplatCloud(
        positions=cloud.positions[rows],
        scales=(cloud.scales[rows] * growth[:, None]).astype(np.float32),
        rotations=cloud.rotations[rows],
        opacities=(cloud.opacities[rows] * part).astype(np.float32),
        sh=cloud.sh[rows],
    )


def ways(source: Path, folder: Path, whole: SplatCloud, report: Report) -> Iterator[Way]:
    """Build the trees, and yield the rows of a table."""
    yield Way("whole", whole, "classic", 1)
    yield Way("whole", whole, "antialiased", SAMPLES)
    wall, cpu = time.perf_counter(), time.process_time()
    built = build_tree(source, folder / "ours.usda")
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    built_in = [("ours", wall, cpu, built.size)]
    stage = Usd.Stage.Open(built.target)
    prim = stage.GetPrimAtPath(built.prim_path)
    levels = [TreeReading.at_level(prim, number) for number in LEVELS]
    counts = list(map(len, levels))
    peer, clouds = peers.spark(), {}
    for method in METHODS if peer else ():
        assert peer is not None
        found = peer.build(source, method, folder, counts)
        # its packed form: 16 bytes for a splat, and 16 for its place in the tree
        built_in.append((method, found["seconds"], found["cpu"], 32 * found["splats"]))
        arrays = [np.fromfile(folder / f"ext{k}.u32", np.uint32).reshape(-1, 4) for k in (0, 1)]
        for count in counts:
            rows = np.fromfile(folder / f"cut_{count}.u32", np.uint32)
            clouds[method, count] = decoded(*(each[rows] for each in arrays))
    for name, wall, cpu, size in built_in:
        print(f"{name}: {wall:.1f} s, {cpu:.1f} s of processors, {size / 1e6:.1f} MB")
        report.add(scene=source.stem, way=f"build {name}", wall=wall, cpu=cpu, bytes=size)
    for level, count in zip(levels, counts, strict=True):
        for scale in (1, SAMPLES):
            yield Way(f"ours {count:,}", level.cloud(), "antialiased", scale)
            for method in METHODS if peer else ():
                some = clouds[method, count]
                label = f"{method} {len(some[0]):,}"
                yield Way(label, drawable(*some, stacked=True), "antialiased", scale, is_peer=True)
                if scale > 1:
                    alone = drawable(*some, stacked=False)
                    yield Way(f"{label}, no stack", alone, "antialiased", scale, is_peer=True)


def main(report: Report) -> None:
    """Print a table for each capture."""
    names, size = asked(report.arguments)
    for sentence in (each for each in peers.missing() if each.startswith("spark")):
        print(sentence)
    renderer = Renderer(open_device())
    distances = [k for k in DISTANCES if k * size[0] <= LARGEST]
    for path in map(Path, names or [DATA / "streamed" / "playbot"]):
        whole = with_sh_degree(formats.read(path).cloud, 0)
        where = Framing.of(whole)
        table = Table(title=f"{path.stem}, {len(whole):,} splats, {size[0]}x{size[1]}: dB")
        for column in ("level", "drawn as", *(f"{distance}x" for distance in distances)):
            table.add_column(column)
        truth = {k: pictures(renderer, whole, where, k, "classic", k, size) for k in distances}
        with tempfile.TemporaryDirectory() as made:
            source = Path(made) / f"{path.stem}.ply"
            formats.write(whole, source)
            for way in ways(source, Path(made), whole, report):
                found = decibels(renderer, way, where, truth, size)
                for k, least in found.items():
                    label = f"{way.label} {way.mode} {way.scale}"
                    report.add(scene=path.stem, way=label, distance=k, db=least)
                kind = f"{way.mode} {way.scale}x{way.scale}"
                table.add_row(way.label, kind, *map(said, found.values()))
        report.show(table, 120)


if __name__ == "__main__":
    with Report("spark_levels", sys.argv[1:]) as report:
        main(report)
