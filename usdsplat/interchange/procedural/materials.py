"""Materials of the still life and recurring colours."""

from __future__ import annotations

from dataclasses import dataclass

Color = tuple[float, float, float]
"""Linear Rec.709."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finish:
    """Optical properties of a material other than its colour."""

    specular: Color = (0.04, 0.04, 0.04)
    """Reflectance at normal incidence [0..1]."""
    gloss: float = 0.0
    """Weight of mirrored surroundings [0..1]; 0 has no view dependence."""
    sharpness: float = 8.0
    """Concentration of the sun's highlight; degree 3 resolves about 10."""
    film: float = 0.0
    """Weight of thin-film colours in the reflection [0..1]."""
    translucency: float = 0.0
    """Fraction of light transmitted from behind [0..1]."""
    opacity: float = 0.98


NACRE = Finish(specular=(0.10, 0.10, 0.10), gloss=0.75, sharpness=9, film=0.60)
LINING = Finish(specular=(0.12, 0.11, 0.11), gloss=0.75, sharpness=7, film=0.40)
GOLD = Finish(specular=(0.95, 0.62, 0.22), gloss=0.95, sharpness=10)
MARBLE = Finish(gloss=0.55, sharpness=10)
GLAZE = Finish(gloss=0.60, sharpness=9)
STONE = Finish(gloss=0.30, sharpness=6)
EARTH = Finish()
LEAF = Finish(specular=(0.03, 0.035, 0.02), gloss=0.3, sharpness=5, translucency=0.45, opacity=0.9)
PETAL = Finish(gloss=0.15, sharpness=4, translucency=0.4, opacity=0.9)

GILT: Color = (0.13, 0.07, 0.02)
"""Diffuse colour of gold; the rest is reflection."""
