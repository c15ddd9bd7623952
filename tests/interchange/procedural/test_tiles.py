"""Tests of the pavement."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usdsplat.interchange.procedural import tiles


@pytest.fixture(scope="module")
def joints() -> np.ndarray:
    """Places of the splats that lie lowest: the joints, shape (n, 2)."""
    rows, _ = tiles.tiles(0.01, seed=3)
    return rows.positions[rows.positions[:, 1] < 0][:, [0, 2]]


def test_joints_are_straight_tangents_of_a_circle(joints: np.ndarray) -> None:
    """Oracle: the normal form of 24 lines 15 degrees apart, 0.30 m from the middle."""
    angle = np.radians(15) * np.arange(24)
    lines = joints @ np.stack([np.cos(angle), np.sin(angle)]) - 0.30
    nearest = np.abs(lines).argmin(axis=1)
    assert np.abs(lines).min(axis=1).max() < 1e-12
    assert len(set(nearest)) == 24


def test_the_pattern_has_the_symmetry_of_its_lines() -> None:
    """Oracle: a turn by one line maps long splats onto long splats."""
    places = tiles.tiles(0.02, seed=3)[0].positions[:, [0, 2]]
    a = math.radians(15)
    turned = places @ np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    gaps = np.abs(places[:, None] - turned[None]).max(axis=2).min(axis=0)
    assert np.quantile(gaps, 0.98) < 1e-9


def test_one_tile_has_one_colour_and_one_tilt() -> None:
    """Oracle: around the middle of the outermost whole rhombus on +x, 12 mm wide."""
    for seed in (3, 4):
        field = tiles.tiles(0.006, seed=seed)[1]
        x, _, z = field.positions.T
        angle = np.arctan2(z, x)
        near = (np.hypot(x - 0.47, z) < 0.006) & (np.abs(angle) < 0.05)
        assert near.sum() >= 2
        assert np.ptp(field.normals[near], axis=0).max() < 1e-12
        assert np.ptp(field.albedo[near] / field.albedo[near].max(axis=0)) < 0.3
