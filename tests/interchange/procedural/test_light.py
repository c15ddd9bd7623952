"""Tests of baking light into harmonics."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.core import sh
from usdsplat.interchange.procedural import light, sky
from usdsplat.interchange.procedural.materials import EARTH, GOLD, Finish
from usdsplat.interchange.procedural.patch import Patch, strands


def plate(finish: Finish, film: float = 0.0) -> Patch:
    """A hundred splats far apart on the floor, facing up."""
    x, z = (g.ravel() * 1.0 for g in np.meshgrid(np.arange(10), np.arange(10)))
    return Patch(
        positions=np.stack([x, np.zeros(100), z], axis=1),
        axes=np.tile(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]).T, (100, 1, 1)),
        sigmas=np.full((100, 3), 0.01),
        albedo=np.full((100, 3), 0.18),
        finish=finish,
        film=film,
    )


def seen_from(patch: Patch, toward_eye: np.ndarray) -> np.ndarray:
    """Colour of the first splat for eyes in these directions, shape (m, 3)."""
    coefficients = light.bake([patch]).sh[:1]
    return sh.evaluate(np.repeat(coefficients, len(toward_eye), 0), -toward_eye.astype(np.float32))


def test_display_is_srgb_over_the_tone_curve() -> None:
    """Oracle: both formulas at middle grey, in float64; black is 0 and the curve never falls."""
    x = 0.18 * light.EXPOSURE
    y = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    assert light.display(np.array([0.18]))[0] == pytest.approx(
        1.055 * y ** (1 / 2.4) - 0.055, abs=1e-3
    )
    ramp = light.display(np.linspace(-1, 20, 500))
    assert ramp[0] == 0 and 0.95 < ramp[-1] <= 1
    assert (np.diff(ramp) >= 0).all()


def test_matt_things_look_the_same_from_everywhere() -> None:
    """Oracle: Lambert: irradiance of sun and open sky times albedo, by hand."""
    cloud = light.bake([plate(EARTH)])
    assert not cloud.sh[:, 1:].any()
    direct = 0.4 * sky.SUN[1] * sky.SUN_COLOR
    upper = sky.spread(4000)[:2000]
    ambient = 2 * (upper[:, 1:2] * sky.environment(upper)).mean(axis=0)
    expected = light.display(0.18 * (direct + ambient))
    np.testing.assert_allclose(seen_from(plate(EARTH), upper[:1])[0], expected, atol=0.02)


def test_a_gold_plate_shines_where_the_law_of_reflection_says() -> None:
    """Oracle: the mirrored direction of the sun, to the width of a degree-3 lobe."""
    toward = sky.spread(800)[:400]
    brightest = toward[seen_from(plate(GOLD), toward).sum(axis=1).argmax()]
    mirrored = sky.SUN * [-1, 1, -1]
    assert brightest @ mirrored > np.cos(np.radians(25))


def test_a_gold_wire_shines_along_a_cone() -> None:
    """Oracle: a thin cylinder mirrors the sun into a cone at the sun's own angle to its axis."""
    wire = strands(np.array([[[0, 0, 0], [1, 0, 0.0]]]), 0.01, (0, 0, 0), GOLD)
    toward = sky.spread(800)
    bright = seen_from(wire, toward).sum(axis=1)
    best = toward[bright > np.quantile(bright, 0.97)]
    assert np.abs(best[:, 0] + sky.SUN[0]).mean() < 0.35
    around = np.arctan2(best[:, 1], best[:, 2]).std() * np.sqrt(1 - sky.SUN[0] ** 2)
    assert around > 1.5 * np.arcsin(best[:, 0]).std()  # a streak, not a spot


def test_a_thin_film_changes_hue_with_the_angle() -> None:
    """Oracle: 3/4 of 545 nm reflect green most face on; aslant 2 d cos(theta) shifts it to blue."""
    toward = np.array([[0, 1, 0], [0.97, 0.24, 0]])
    mirror = seen_from(plate(Finish(gloss=0.6, specular=(1, 1, 1))), toward)
    film = seen_from(plate(Finish(gloss=0.6, film=1.0), 0.75 * 545), toward)
    steep, flat = film / mirror
    assert steep[1] > steep[0] + 0.02 and steep[1] > steep[2] + 0.05
    assert flat[2] > flat[1]


def test_leaves_glow_against_the_sun() -> None:
    """Oracle: the same leaf, without and with light through it, seen from both sides of the sun."""
    toward = np.stack([sky.SUN, -sky.SUN])
    opaque = seen_from(plate(Finish(gloss=1e-6)), toward).sum(axis=1)
    leaf = seen_from(plate(Finish(gloss=1e-6, translucency=0.5)), toward).sum(axis=1)
    assert leaf[1] - opaque[1] > leaf[0] - opaque[0] + 0.05
