"""Photographs with lens and pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdsplat.core import quaternion
from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError
from usdsplat.formats.cameras.lens import Lens

MOST = 100_000
"""Maximum number of cameras; a file with more is rejected as corrupt."""
_RIGHT_ANGLES = 1e-4
"""Tolerance for the orthogonality of a similarity's axes: files contain rounded numbers."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posed:
    """A photograph with its lens and pose."""

    name: str
    """Image name as in the file: a path relative to the folder of images."""
    lens: Lens
    to_capture: F64
    """Transformation from camera to capture, a rotation and a translation, shape (4, 4), for column
    vectors. Camera axes are OpenCV's: x right, y down, z forward."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraSet:
    """The photographs of a capture."""

    format: str
    """Format for display: "COLMAP binary", "transforms.json"."""
    files: tuple[Path, ...]
    """Files that were read."""
    cameras: tuple[Posed, ...]
    """In the order of the file."""
    notes: tuple[str, ...] = ()
    """Assumptions of the reader, one sentence each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stored:
    """A photograph as COLMAP stores it."""

    name: str
    lens: Lens
    pose: Sequence[float]
    """World to camera: a quaternion (w, x, y, z) of any length, then the translation, which is the
    world's origin in camera space."""


def carried(pose: F64, matrix: F64) -> F64:
    """Return the pose of a camera after a similarity moves it together with the scene.

    The camera sees the same picture as before.

    Args:
        pose: A rotation and a translation, shape (4, 4).
        matrix: A rotation, a uniform scale and a translation, shape (4, 4).

    Returns:
        A rotation and a translation, shape (4, 4); the scale is dropped from the rotation.

    Raises:
        ValueError: If the matrix mirrors, shears or is not finite.
    """
    linear = matrix[:3, :3]
    scale = np.cbrt(np.linalg.det(linear))
    slack = _RIGHT_ANGLES * scale**2
    if not (scale > 0 and np.allclose(linear @ linear.T, scale**2 * np.eye(3), 0.0, slack)):
        raise ValueError("carried: found a matrix that mirrors or shears, expected a similarity")
    moved: F64 = matrix @ pose
    moved[:3, :3] /= scale
    return moved


def from_world_to_camera(where: str, stored: Sequence[Stored]) -> tuple[Posed, ...]:
    """Convert photographs with COLMAP's world-to-camera poses to camera-to-capture poses.

    Args:
        where: Name of the file in error messages.
        stored: Photographs as stored in the file.

    Raises:
        FormatError: If a number is not finite, or a quaternion is zero.
    """
    poses = np.array([photograph.pose for photograph in stored], np.float64).reshape(-1, 7)
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(poses[:, :4], axis=1)
    sound = np.isfinite(poses).all(axis=1) & (lengths > 0) & np.isfinite(lengths)
    if not sound.all():
        bad = int(np.argmin(sound))
        found = " ".join(f"{number:g}" for number in poses[bad])
        expected = "a quaternion and a translation"
        raise FormatError(f"{where}: {stored[bad].name[:80]}", f"pose {found}", expected)
    turns = quaternion.to_matrix(poses[:, :4] / lengths[:, None])
    to_capture = np.tile(np.eye(4), (len(poses), 1, 1))
    to_capture[:, :3, :3] = turns.transpose(0, 2, 1)
    to_capture[:, :3, 3] = -np.einsum("nji,nj->ni", turns, poses[:, 4:])
    return tuple(
        Posed(name=photograph.name, lens=photograph.lens, to_capture=matrix)
        for photograph, matrix in zip(stored, to_capture, strict=True)
    )


def checked_count(where: str, count: int) -> int:
    """Return `count` if it is a plausible number of cameras.

    Raises:
        FormatError: If there is none, or more than `MOST`.
    """
    if not 0 < count <= MOST:
        raise FormatError(where, f"{count} cameras", f"1 to {MOST}")
    return count
