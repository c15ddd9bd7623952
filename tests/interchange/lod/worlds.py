"""Small worlds for tests of trees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.sh import coefficient_count
from usdsplat.interchange.lod.sources import Source

NAMES = ("positions", "scales", "rotations", "opacities", "sh")
"""Arrays of a cloud."""


def ground(count: int, degree: int = 0, seed: int = 0) -> SplatCloud:
    """Opaque discs on a wavy square of edge 2, whose colour is that of their place."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-1, 1, (count, 2))
    height = 0.1 * np.sin(4 * flat[:, 0]) * np.cos(3 * flat[:, 1])
    size = 2 / np.sqrt(count)
    sh = np.zeros((count, coefficient_count(degree), 3), np.float32)
    sh[:, 0] = np.sin(3 * np.stack([flat[:, 0], flat[:, 1], flat.sum(axis=1)], axis=1))
    sh[:, 1:] = rng.normal(0, 0.05, sh[:, 1:].shape)
    turns = rng.normal(0, 0.1, (count, 4)) + np.array([1, 0, 0, 0])
    return SplatCloud(
        positions=np.stack([flat[:, 0], height, flat[:, 1]], axis=1).astype(np.float32),
        scales=(size * rng.uniform((0.5, 0.05, 0.5), (1, 0.1, 1), (count, 3))).astype(np.float32),
        rotations=(turns / np.linalg.norm(turns, axis=1, keepdims=True)).astype(np.float32),
        opacities=rng.uniform(0.6, 0.99, count).astype(np.float32),
        sh=sh,
    )


def in_parts(source: Source, counts: Sequence[int], size: int) -> SplatCloud:
    """All splats of an input of a tree, read in pieces of `size`."""
    found = []
    for part, count in enumerate(counts):
        for first in range(0, count, size):
            found.append(source.rows(part, first, min(count, first + size), np.eye(4)))
    return edit.merge(found)


def tree_bytes(target: Path) -> dict[str, bytes]:
    """The files of a tree, chunks by their names."""
    chunks = sorted(target.with_name(f"{target.stem}_chunks").iterdir())
    return {path.name: path.read_bytes() for path in (target, *chunks)}
