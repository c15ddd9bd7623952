"""Captures to import, and their contents as read by independent code."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from tests.schema.clouds import cloud
from usdsplat import formats
from usdsplat.core.cloud import SplatCloud


def capture(folder: Path, name: str = "tree.ply", *, antialiased: bool = False, **of: int) -> Path:
    """A small .ply; `of` are arguments of `cloud`."""
    formats.write(cloud(**of), folder / name, how=formats.WriteOptions(antialiased=antialiased))
    return folder / name


def read_ply(path: Path) -> dict[str, np.ndarray]:
    """Physical values of a 3DGS .ply by plyfile and the format's definition alone, float64."""
    from plyfile import PlyData

    rows = PlyData.read(str(path))["vertex"].data

    def columns(*names: str) -> np.ndarray:
        return np.stack([rows[name].astype(np.float64) for name in names], axis=1)

    rest = sum(name.startswith("f_rest_") for name in rows.dtype.names)
    dc = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    higher = columns(*(f"f_rest_{i}" for i in range(rest))) if rest else np.zeros((len(rows), 0))
    higher = higher.reshape(len(rows), 3, rest // 3).transpose(0, 2, 1)
    rotations = columns("rot_0", "rot_1", "rot_2", "rot_3")
    return {
        "positions": columns("x", "y", "z"),
        "scales": np.exp(columns("scale_0", "scale_1", "scale_2")),
        "rotations": rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        "opacities": 1 / (1 + np.exp(-rows["opacity"].astype(np.float64))),
        "sh": np.concatenate([dc, higher], axis=1),
    }


def assert_same(a: SplatCloud, b: SplatCloud) -> None:
    """Every array equal, bit for bit."""
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert (x is None) == (y is None), field.name
        if x is not None:
            np.testing.assert_array_equal(x, y, err_msg=field.name)


def covariances(found: SplatCloud) -> np.ndarray:
    """R diag(s^2) R^T by rotating the unit axes, float64, shape (n, 3, 3)."""
    w, x, y, z = found.rotations.astype(np.float64).T
    axes = np.stack(
        [
            np.stack([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)]),
            np.stack([2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)]),
            np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z]),
        ]
    ).transpose(2, 0, 1)  # row j of each matrix is where local axis j goes
    scaled = axes * found.scales.astype(np.float64)[:, :, None]
    return np.einsum("nji,njk->nik", scaled, scaled)
