"""Differences between two clouds, splat by splat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import SplatCloud


@dataclass(frozen=True, slots=True)
class Differences:
    """Largest differences between two clouds of the same splats in the same order."""

    position: float
    log_scale: float
    rotation: float
    """[degree]"""
    opacity: float
    dc: float
    harmonics: float
    """Above degree 0; 0 where there are none."""


def differences(
    a: SplatCloud, b: SplatCloud, keep: np.ndarray | slice = slice(None)
) -> Differences:
    """Compare in float64; `keep` selects splats."""
    parts = [
        (
            np.asarray(getattr(a, name), np.float64)[keep],
            np.asarray(getattr(b, name), np.float64)[keep],
        )
        for name in ("positions", "scales", "rotations", "opacities", "sh")
    ]
    place, size, turn, opacity, sh = parts
    chord = np.minimum(*(np.linalg.norm(turn[0] + sign * turn[1], axis=1) for sign in (1, -1)))
    return Differences(
        position=_largest(place[0] - place[1]),
        log_scale=_largest(np.log(size[0]) - np.log(size[1])),
        rotation=float(np.degrees(4 * np.arcsin(chord.max() / 2))),
        opacity=_largest(opacity[0] - opacity[1]),
        dc=_largest(sh[0][:, 0] - sh[1][:, 0]),
        harmonics=_largest(sh[0][:, 1:] - sh[1][:, 1:]),
    )


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max(initial=0.0))
