"""Cameras with a place in the capture."""

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
"""Cameras that are read; a file that has more is taken for a lie."""
_RIGHT_ANGLES = 1e-4
"""How far from them the axes of a similarity may be: those of files are rounded."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posed:
    """One photograph."""

    name: str
    """The image, as the file calls it: a path relative to the images' folder."""
    lens: Lens
    to_capture: F64
    """Camera to capture, shape (4, 4), column vectors: a rotation and a translation. The camera's x
    points right, y down and z forward, as OpenCV has it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraSet:
    """All photographs of a capture."""

    format: str
    """For people: "COLMAP binary", "transforms.json"."""
    files: tuple[Path, ...]
    """What was read."""
    cameras: tuple[Posed, ...]
    """In the order of the file."""
    notes: tuple[str, ...] = ()
    """What was assumed, a sentence each."""


def carried(pose: F64, matrix: F64) -> F64:
    """A camera that goes where a similarity takes what it sees, and sees the same picture.

    Args:
        pose: A rotation and a translation, shape (4, 4).
        matrix: A rotation, a uniform scale and a translation, shape (4, 4).

    Returns:
        A rotation and a translation, shape (4, 4): cameras have no size.

    Raises:
        ValueError: If the matrix is none such: it mirrors, shears or is not finite.
    """
    linear = matrix[:3, :3]
    scale = np.cbrt(np.linalg.det(linear))
    slack = _RIGHT_ANGLES * scale**2
    if not (scale > 0 and np.allclose(linear @ linear.T, scale**2 * np.eye(3), 0.0, slack)):
        raise ValueError("carried: found a matrix that mirrors or shears, expected a similarity")
    moved: F64 = matrix @ pose
    moved[:3, :3] /= scale
    return moved


def from_world_to_camera(
    where: str, name: str, lens: Lens, rotation: Sequence[float], translation: Sequence[float]
) -> Posed:
    """A photograph whose pose is stored the other way round, as COLMAP does.

    Args:
        where: Names it in errors.
        rotation: World to camera, a quaternion (w, x, y, z) of any length.
        translation: The world's origin as the camera has it.

    Raises:
        FormatError: If a number is not finite, or the quaternion is zero.
    """
    numbers = np.array([*rotation, *translation], np.float64)
    length = float(np.linalg.norm(numbers[:4]))
    if not (np.isfinite(numbers).all() and 0 < length < np.inf):
        found = " ".join(f"{number:g}" for number in numbers)
        raise FormatError(where, f"pose {found}", "a quaternion and a translation")
    to_camera = quaternion.to_matrix(numbers[None, :4] / length)[0]
    to_capture = np.eye(4)
    to_capture[:3, :3] = to_camera.T
    to_capture[:3, 3] = -to_camera.T @ numbers[4:]
    return Posed(name=name, lens=lens, to_capture=to_capture)


def checked_count(where: str, count: int) -> int:
    """The same number, if so many cameras can be meant.

    Raises:
        FormatError: If there is none, or more than `MOST`.
    """
    if not 0 < count <= MOST:
        raise FormatError(where, f"{count} cameras", f"1 to {MOST}")
    return count
