"""Styles of growth: the pattern and the new matter by name."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from usdsplat.sim.parameters import AccretionParameters, Parameters, RdParameters

KEPT = ("enabled", "style", "light")
"""Knobs that a style leaves as they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """One look of growth."""

    feed: float
    kill: float
    """Rates of the reaction."""
    knobs: dict[str, Any]
    """Knobs of accretion that differ from the defaults."""


STYLES: dict[str, Style] = {
    # round cells that touch, with dark seams
    "cells": Style(
        feed=0.030, kill=0.0585,
        knobs={
            "motif": "cells", "motif_size": 10.0, "relief": 3.4, "layers": 3, "size": 0.55,
            "ramp": (
                (0.02, 0.04, 0.05), (0.05, 0.30, 0.25), (0.50, 0.84, 0.56), (0.80, 1.0, 0.72),
                (0.95, 1.05, 0.84), (0.50, 0.36, 0.55), (0.34, 0.14, 0.46),
            ),
            "tints": ((1.0, 1.0, 1.0), (0.86, 1.02, 0.90), (1.08, 1.02, 0.85), (0.85, 0.94, 1.1)),
            "occlusion": 0.35, "shade": 0.55, "variation": 0.06, "gloss": 0.35, "jitter": 0.2,
        },
    ),
    # colonies of fingers that branch, with pale tips
    "coral": Style(
        feed=0.0545, kill=0.062,
        knobs={
            "motif": "corals", "motif_size": 7.2, "relief": 27.0, "layers": 8, "size": 0.62,
            "thickness": 0.08, "opacity": 0.97, "jitter": 0.2, "tilt": 14.0, "variation": 0.2,
            "rise": 0.15, "occlusion": 0.65, "shade": 0.52, "gloss": 0.06,
            "ramp": (
                (0.50, 0.10, 0.08), (0.86, 0.24, 0.17), (0.98, 0.40, 0.30), (1.0, 0.60, 0.48),
                (1.2, 1.10, 1.0),
            ),
            "tints": (
                (1.0, 1.0, 1.0), (1.02, 1.22, 0.85), (0.98, 0.82, 1.25), (1.0, 0.8, 0.85),
            ),
        },
    ),
    # thin raised lines
    "veins": Style(
        feed=0.046, kill=0.063,
        knobs={
            "motif": "veins", "motif_size": 9.0, "relief": 2.9, "layers": 5, "thickness": 0.06,
            "ramp": (
                (0.16, 0.01, 0.12), (0.42, 0.02, 0.16), (0.66, 0.05, 0.15), (0.78, 0.12, 0.16),
            ),
            "gloss": 0.6, "shade": 0.7, "opacity": 0.97,
        },
    ),
    # a soft cover of small tilted leaves, thickest on top
    "moss": Style(
        feed=0.026, kill=0.051,
        knobs={
            "low": 0.04, "high": 0.22, "relief": 2.4, "profile": "dome", "layers": 6,
            "size": 0.26, "thickness": 0.5, "jitter": 0.9, "tilt": 55.0, "variation": 0.6,
            "upward": 0.6, "ramp_by": "curvature",
            "ramp": ((0.03, 0.06, 0.01), (0.14, 0.26, 0.04), (0.45, 0.56, 0.14)),
        },
    ),
    # needles on islands
    "crystals": Style(
        feed=0.0367, kill=0.0649,
        knobs={
            "motif": "needles", "motif_size": 5.0, "relief": 24.0, "layers": 5, "size": 0.42,
            "thickness": 0.05, "opacity": 0.97, "shade": 0.9, "gloss": 0.8,
            "ramp": ((0.30, 0.22, 0.58), (0.52, 0.50, 0.88), (0.80, 0.84, 1.0)),
            "tints": (
                (1.0, 1.0, 1.0), (0.62, 0.98, 1.0), (1.1, 0.62, 0.95), (0.72, 0.66, 1.15),
                (1.2, 1.15, 1.05),
            ),
        },
    ),
    # flat pale plates that grow from their margins
    "lichen": Style(
        feed=0.039, kill=0.058,
        knobs={
            "motif": "plates", "motif_size": 20.0, "relief": 2.0, "layers": 2, "size": 0.45,
            "thickness": 0.16, "jitter": 0.35, "tilt": 16.0, "variation": 0.3,
            "ramp": (
                (1.10, 1.10, 1.0), (1.05, 1.05, 0.92), (0.80, 0.82, 0.70), (0.88, 0.90, 0.78),
                (0.45, 0.34, 0.20),
            ),
            "tints": (
                (1.1, 0.66, 0.10), (1.1, 0.80, 0.22), (0.88, 1.0, 0.86), (0.95, 1.0, 0.95),
                (0.72, 0.86, 0.62),
            ),
            "occlusion": 0.35, "shade": 0.5,
        },
    ),
}  # fmt: skip
"""Style -> its pattern and knobs."""


def reaction_of(parameters: Parameters) -> RdParameters:
    """Return the knobs of the reaction: with the rates of the style, where new matter has one."""
    style = STYLES.get(parameters.accretion.style)
    if style is None or not parameters.accretion.enabled:
        return parameters.rd
    return replace(parameters.rd, preset="custom", feed=style.feed, kill=style.kill)


def resolved(parameters: AccretionParameters) -> AccretionParameters:
    """Return the knobs of the style; the parameters themselves if it is custom."""
    if parameters.style == "custom":
        return parameters
    own = {f.name: getattr(parameters, f.name) for f in fields(parameters) if f.name in KEPT}
    return replace(AccretionParameters(), **own, **STYLES[parameters.style].knobs)
