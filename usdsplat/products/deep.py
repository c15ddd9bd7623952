"""Draw a deep picture into its file, band by band, and compare it with the flat one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.delegate.engine import Engine
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.products.deep_color import MEANING, scaled_to
from usdsplat.products.deep_ids import DeepIds, deep_ids
from usdsplat.products.flat_rows import FlatRows
from usdsplat.products.flattening import flattened
from usdsplat.products.picture_file import PictureFile, RowsWritten
from usdsplat.render.deep_memory import DeepSize


@dataclass(slots=True)
class DeepReport:
    """Size of a deep picture, and its difference from the flat one in linear light.

    With `deep_color` beauty, it is that of the colours as they are stored.
    """

    samples: int = 0
    pixels: int = 0
    bytes: int = 0
    compared: bool = False
    blend_space: str = "auto"
    """`RenderSettings.blend_space` of the flat picture."""
    squares: float = 0.0
    """Sum of squared differences over red, green and blue of all pixels."""
    worst: float = 0.0
    """Largest absolute difference."""
    missing: int = 0
    """See `FrameStats.missing`; the flat picture may have been drawn with more nodes."""

    @property
    def decibels(self) -> float:
        """Peak signal-to-noise ratio for a peak of 1 [dB]; infinite for equal pictures."""
        mean = self.squares / (3 * self.pixels)
        return math.inf if mean == 0 else -10 * math.log10(mean)

    def add(self, difference: F32) -> None:
        """Add the differences of some pixels, shape (h, w, 3)."""
        self.squares += float(np.sum(difference.astype(np.float64) ** 2))
        self.worst = max(self.worst, float(np.abs(difference).max(initial=0)))


def draw_deep(engine: Engine, file: PictureFile, *, rows_written: RowsWritten) -> DeepReport:
    """Draw a deep picture at the engine's time. For arguments see `draw_flat`.

    Raises:
        UsageError: If splats are not sorted by planar depth, or a row has too many samples.
        OutputError: If the file cannot be written.
    """
    report = DeepReport()
    write_deep(file, deep_bands(engine, file, report), report, rows_written=rows_written)
    return report


def write_deep(
    file: PictureFile,
    bands: Iterable[tuple[int, DeepBand]],
    report: DeepReport,
    *,
    rows_written: RowsWritten,
) -> None:
    """Write the bands of a deep picture, see `deep_bands`, into its file, and report its size. For
    errors see `draw_deep`."""
    settings, layout = file.plan.settings, file.layout
    if settings.deep_color == "beauty":
        layout = replace(layout, metadata={**layout.metadata, "usdsplat:aov:color": MEANING})
    with DeepWriter(file.path, layout, merged=settings.deep_error > 0) as writer:
        for y0, band in bands:
            writer.write_band(y0, band)
            rows_written(y0 + len(band.counts) - file.layout.window[1])
    report.bytes = file.path.stat().st_size


def deep_bands(
    engine: Engine, file: PictureFile, report: DeepReport
) -> Iterator[tuple[int, DeepBand]]:
    """Yield the first row and the samples of each band of a deep picture at the engine's time.

    Args:
        report: Receives the number of samples, and the differences from the flat picture.

    Raises:
        UsageError: As `draw_deep` does.
    """
    plan, view, settings = file.plan, file.view, file.plan.settings
    report.compared, report.blend_space = plan.compare, settings.blend_space
    bands = engine.render_deep(
        view,
        settings,
        deep_ids(plan.aovs),
        holdout=file.holdout,
        size=DeepSize(band_pixels=file.band_pixels, entries=file.deep_entries),
    )
    flat = None
    if plan.needs_flat:
        in_scene = replace(settings, color_mode="scene")
        flat = FlatRows(
            engine.render(view, in_scene, holdout=file.holdout, band_pixels=file.band_pixels)
        )
    stored = np.float32 if file.layout.pixel_type == "float" else np.float16
    ids = DeepIds(engine, plan)
    for y0, y1, samples in bands:
        report.missing = engine.stats.missing
        beauty = None if flat is None else flat.take(y1 - y0)
        if settings.deep_color == "beauty" and beauty is not None:
            samples = scaled_to(samples, beauty, stored)
        report.samples += len(samples.depth)
        report.pixels += samples.counts.size
        if plan.compare and beauty is not None:
            report.add(flattened(samples)[..., :3] - beauty[..., :3])
        yield (
            y0,
            DeepBand(
                counts=samples.counts,
                depth=samples.depth,
                depth_back=samples.depth_back,
                color=samples.color,
                ids=ids.channels(samples),
            ),
        )
