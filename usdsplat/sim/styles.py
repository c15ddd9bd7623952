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
            "low": 0.10, "high": 0.30, "relief": 2.4, "profile": "dome", "layers": 3,
            "ramp": ((0.05, 0.10, 0.12), (0.16, 0.42, 0.45), (0.72, 0.88, 0.80)),
            "occlusion": 0.9, "variation": 0.15,
        },
    ),
    # thick branches with light tips
    "coral": Style(
        feed=0.0545, kill=0.062,
        knobs={
            "relief": 3.8, "profile": "dome", "layers": 5, "ramp_by": "curvature",
            "ramp": ((0.20, 0.03, 0.04), (0.62, 0.10, 0.08), (0.98, 0.52, 0.38)),
        },
    ),
    # thin raised lines
    "veins": Style(
        feed=0.046, kill=0.063,
        knobs={
            "low": 0.12, "high": 0.34, "relief": 1.5, "profile": "ridge", "layers": 2,
            "size": 0.5, "ramp": ((0.10, 0.01, 0.05), (0.38, 0.02, 0.10), (0.80, 0.12, 0.16)),
            "variation": 0.12, "jitter": 0.2, "tilt": 5.0,
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
            "low": 0.08, "high": 0.36, "relief": 6.0, "profile": "thorn", "layers": 4,
            "size": 0.30, "thickness": 1.5, "jitter": 0.7, "tilt": 24.0, "variation": 0.5,
            "opacity": 0.85, "occlusion": 0.5, "shade": 0.6,
            "ramp": ((0.16, 0.22, 0.50), (0.42, 0.60, 0.92), (0.93, 0.97, 1.0)),
            "ramp_by": "height",
        },
    ),
    # flat pale plates that grow from their margins
    "lichen": Style(
        feed=0.039, kill=0.058,
        knobs={
            "low": 0.10, "high": 0.16, "relief": 0.8, "profile": "plate", "layers": 2,
            "size": 0.55, "thickness": 0.12, "jitter": 0.5, "tilt": 14.0, "variation": 0.35,
            "ramp_by": "age", "ramp_time": 2.5,
            "ramp": ((0.80, 0.76, 0.42), (0.60, 0.66, 0.44), (0.50, 0.55, 0.47)),
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
