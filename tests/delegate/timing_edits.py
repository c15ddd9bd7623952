"""Random edits of a stage's time metadata and of values between samples."""

from __future__ import annotations

from pxr import Sdf, Usd


class TimingEdits:
    """The part of an `Editor` that changes time itself."""

    def restructure_timing(self) -> None:
        self._random.choice([self._interpolate, self._count, self._offset])()

    def _interpolate(self) -> None:
        kinds = (Usd.InterpolationTypeHeld, Usd.InterpolationTypeLinear)
        self.stage.SetInterpolationType(self._random.choice(kinds))

    def _count(self) -> None:
        self.stage.SetEditTarget(self.stage.GetRootLayer())
        self.stage.SetTimeCodesPerSecond(self._random.choice([24.0, 48.0]))

    def _offset(self) -> None:
        root = self.stage.GetRootLayer()
        if root.subLayerPaths:
            start, scale = self._random.choice([0.0, 1.0]), self._random.choice([1.0, 2.0])
            number = self._random.randrange(len(root.subLayerPaths))
            root.subLayerOffsets[number] = Sdf.LayerOffset(start, scale)
