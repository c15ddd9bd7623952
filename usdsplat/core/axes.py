"""Coordinate systems, named by the directions of their axes.

Three letters name the directions of x, y and z as seen by the viewer: right or left, up or down,
forward or back. "rdf" is used by COLMAP and most captures (x right, y down, z forward), "rub" by
OpenGL and by USD with upAxis = Y, "rfu" by USD with upAxis = Z.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.core.errors import UsageError

_DIRECTIONS = {
    "r": (1, 0, 0),
    "l": (-1, 0, 0),
    "u": (0, 1, 0),
    "d": (0, -1, 0),
    "b": (0, 0, 1),
    "f": (0, 0, -1),
}

UP_AXIS_FRAME = {"Y": "rub", "Z": "rfu"}
"""A stage's upAxis -> the axes of its coordinates."""


def frame_matrix(frame: str) -> F64:
    """Return the signed permutation from coordinates in `frame` to the reference "rub".

    Returns:
        Shape (3, 3), column-vector convention; its determinant is -1 for a left-handed frame.

    Raises:
        UsageError: If `frame` does not name three mutually perpendicular directions.
    """
    known = len(frame) == 3 and all(letter in _DIRECTIONS for letter in frame)
    matrix = np.array([_DIRECTIONS[letter] for letter in frame], np.float64).T if known else None
    if matrix is None or abs(np.linalg.det(matrix)) < 0.5:
        raise UsageError(
            "axes", repr(frame), "the directions of x, y and z, such as 'rdf' or 'rub'"
        )
    return matrix


def flipped(frame: str) -> str:
    """Return the axes of a capture that is shown upside down, half a turn about the direction
    right: "rub" for "rdf"."""
    return frame.translate(str.maketrans("udfb", "dubf"))


def change(source: str, target: str) -> F64:
    """Return the signed permutation from axes `source` to axes `target`, shape (3, 3).

    Raises:
        UsageError: If either does not name axes.
    """
    return frame_matrix(target).T @ frame_matrix(source)
