"""Presets of the reaction: a feed and a kill rate by name.

Source: Pearson 1993 and later results on his map. Each was verified on 20,000 relaxed points of a
sphere; a test repeats it.
"""

from __future__ import annotations

from usdsplat.sim.parameters import RdParameters

PRESETS: dict[str, tuple[float, float]] = {
    "spots": (0.0367, 0.0649),
    "worms": (0.046, 0.063),
    "labyrinth": (0.037, 0.060),
    "coral": (0.0545, 0.062),
    "holes": (0.039, 0.058),
    "chaos": (0.026, 0.051),
    "uskate": (0.062, 0.0609),
}
"""Name -> (F, k), for Du 0.16 and Dv 0.08."""


def rates(parameters: RdParameters) -> tuple[float, float]:
    """Return feed and kill rate: those of the preset, or the parameters' own if it is custom."""
    return PRESETS.get(parameters.preset, (parameters.feed, parameters.kill))
