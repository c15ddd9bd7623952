"""Measure writing and reading a deep EXR, with ours and with other libraries from Python.

    python -m benchmarks.deep [SAMPLES A PIXEL]

1920x1080. OpenImageIO, whose Python interface passes values one by one, processes a few rows, and
its times are scaled. The OpenEXR wheel, which takes the whole picture with one object per pixel, is
included if it is installed (`pip install OpenEXR`). It processes some rows, too.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from rich.table import Table

from benchmarks.report import Report
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.deep_reader import read_deep
from usdsplat.images.layout import ImageLayout

WIDTH, HEIGHT = 1920, 1080
BAND = 120
REPEATS = 3


def band(rows: int, mean: int) -> DeepBand:
    """Return rows of soft discs of 16 pixels, each with its own colour and slanted depth."""
    y, x = np.divmod(np.arange(rows * WIDTH), WIDTH)
    counts = (2 * mean * (0.5 + 0.5 * np.sin(x / 90 + y / 70))).astype(np.int64)
    pixel = np.repeat(np.arange(rows * WIDTH), counts)
    rank = np.arange(len(pixel)) - np.repeat(np.cumsum(counts) - counts, counts)
    disc = (y[pixel] // 16 * WIDTH + x[pixel] // 16) * 64 + rank
    random = np.random.default_rng(0).random((int(disc.max(initial=0)) + 1, 4), np.float32)[disc]
    off_centre = np.hypot(x[pixel] % 16 - 8, y[pixel] % 16 - 8).astype(np.float32)
    alpha = np.maximum(random[:, 3] * np.exp(-0.03 * off_centre**2), np.float32(1 / 255))
    depth = (2 + 0.2 * rank + 0.15 * random[:, 0] + 0.002 * (x[pixel] % 16)).astype(np.float32)
    color = np.concatenate([random[:, :3] * alpha[:, None], alpha[:, None]], axis=1)
    table = counts.astype(np.uint32).reshape(rows, WIDTH)
    return DeepBand(counts=table, depth=depth, depth_back=depth, color=color)


def seconds(action: Callable[[], object]) -> float:
    """Return the median wall time of a call."""
    spent = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        spent.append(time.perf_counter() - start)
    return float(np.median(spent))


def write_ours(path: Path, part: DeepBand, compression: str) -> None:
    """Write a picture that repeats one band, with our writer."""
    layout = ImageLayout(resolution=(WIDTH, HEIGHT), compression=compression)
    with DeepWriter(path, layout) as writer:
        for y in range(0, HEIGHT, BAND):
            writer.write_band(y, part)


def deep_data(part: DeepBand) -> tuple[oiio.DeepData, oiio.ImageSpec]:
    """Return a band in the form of OpenImageIO."""
    spec = oiio.ImageSpec(WIDTH, len(part.counts), 5, "half")
    spec.channelnames = ("R", "G", "B", "A", "Z")
    spec.channelformats = ("half", "half", "half", "half", "float")
    spec.deep = True
    spec.attribute("compression", "none")
    data = oiio.DeepData()
    data.init(spec)
    at = 0
    for pixel, count in enumerate(part.counts.ravel().tolist()):
        data.set_samples(pixel, count)
        for sample in range(count):
            for channel in range(4):
                data.set_deep_value(pixel, channel, sample, float(part.color[at, channel]))
            data.set_deep_value(pixel, 4, sample, float(part.depth[at]))
            at += 1
    return data, spec


def write_openimageio(path: Path, part: DeepBand) -> None:
    """Write a picture of a band's rows, with OpenImageIO."""
    data, spec = deep_data(part)
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), spec)
    file.write_deep_image(data)
    file.close()


def read_openimageio(path: Path) -> int:
    """Read every value with OpenImageIO. Return their number."""
    file = oiio.ImageInput.open(str(path))
    data = file.read_native_deep_image()
    file.close()
    values = [
        data.deep_value(pixel, channel, sample)
        for pixel in range(data.pixels)
        for sample in range(data.samples(pixel))
        for channel in range(5)
    ]
    return len(values)


def write_wheel(path: Path, part: DeepBand) -> None:
    """Write a picture of a band's rows, with the OpenEXR wheel."""
    import OpenEXR

    ends = np.cumsum(part.counts.ravel())[:-1]

    def objects(values: np.ndarray) -> np.ndarray:
        found = np.empty(part.counts.size, object)
        found[:] = np.split(values, ends)
        return found.reshape(part.counts.shape)

    half = part.color.astype(np.float16)
    channels = {name: objects(half[:, i].copy()) for i, name in enumerate("RGBA")}
    channels["Z"] = objects(part.depth)
    kind = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.deepscanline}
    OpenEXR.File(kind, channels).write(str(path))


def read_wheel(path: Path) -> object:
    """Read all channels with the OpenEXR wheel."""
    import OpenEXR

    return OpenEXR.File(str(path), separate_channels=True).channels()


def main(report: Report, mean: int = 15) -> None:
    """Print the table."""
    table = Table("", "write [s]", "read [s]", "MB", title=f"{WIDTH}x{HEIGHT}, {mean} a pixel")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"

        def row(
            name: str, rows: int, write: Callable[[], object], read: Callable[[], object]
        ) -> None:
            scale = HEIGHT / rows
            spent = [f"{seconds(action) * scale:.2f}" for action in (write, read)]
            table.add_row(name, *spent, f"{path.stat().st_size * scale / 1e6:.0f}")

        part = band(BAND, mean)
        for compression in ("none", "zips"):
            row(
                f"usdsplat, {compression}",
                HEIGHT,
                lambda compression=compression: write_ours(path, part, compression),
                lambda: read_deep(path),
            )
        if importlib.util.find_spec("OpenEXR"):
            some = band(54, mean)
            row(
                "OpenEXR wheel, none",
                54,
                lambda: write_wheel(path, some),
                lambda: read_wheel(path),
            )
        few = band(2, mean)
        row(
            "OpenImageIO, none",
            2,
            lambda: write_openimageio(path, few),
            lambda: read_openimageio(path),
        )
    report.show(table)


if __name__ == "__main__":
    with Report("deep", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
