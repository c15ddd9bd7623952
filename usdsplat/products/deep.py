"""Draw a deep picture into its file, band by band, and compare it with the flat one."""

from __future__ import annotations

import math
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
    plan, view, settings = file.plan, file.view, file.plan.settings
    report = DeepReport(compared=plan.compare, blend_space=settings.blend_space)
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
    layout, scales = file.layout, settings.deep_color == "beauty"
    stored = np.float32 if layout.pixel_type == "float" else np.float16
    if scales:
        layout = replace(layout, metadata={**layout.metadata, "usdsplat:aov:color": MEANING})
    ids = DeepIds(engine, plan)
    writer = DeepWriter(file.path, layout, merged=settings.deep_error > 0)
    with writer:
        for y0, y1, samples in bands:
            report.missing = engine.stats.missing
            beauty = None if flat is None else flat.take(y1 - y0)
            if scales and beauty is not None:
                samples = scaled_to(samples, beauty, stored)
            band = DeepBand(
                counts=samples.counts,
                depth=samples.depth,
                depth_back=samples.depth_back,
                color=samples.color,
                ids=ids.channels(samples),
            )
            writer.write_band(y0, band)
            report.samples += len(samples.depth)
            report.pixels += samples.counts.size
            if plan.compare and beauty is not None:
                report.add(flattened(samples)[..., :3] - beauty[..., :3])
            rows_written(y1 - file.layout.window[1])
    report.bytes = file.path.stat().st_size
    return report
