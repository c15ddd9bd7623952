"""Times of what a layer says."""

from __future__ import annotations

from pxr import Sdf


def scale_times(layer: Sdf.Layer, factor: float) -> None:
    """Multiply the times of all time samples of a layer, which gets another number of time codes
    per second. Splines, value clips, and offsets of references and sublayers stay as they are.

    Args:
        layer: Changed in place.
        factor: The new rate, relative to the one before.
    """

    def scale(path: Sdf.Path) -> None:
        times = layer.ListTimeSamplesForPath(path) if path.IsPropertyPath() else []
        samples = {time: layer.QueryTimeSample(path, time) for time in times}
        for time in samples:
            layer.EraseTimeSample(path, time)
        for time, value in samples.items():
            layer.SetTimeSample(path, factor * time, value)

    if factor != 1.0:
        layer.Traverse(Sdf.Path.absoluteRootPath, scale)
