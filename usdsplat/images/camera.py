"""Describe the camera of a picture in header entries that compositing packages know.

OpenEXR's matrices are for row vectors, so a point is multiplied from the left. Its camera space is
left-handed (x right, y up, z in viewing direction). Its normalised device coordinates go from
(0, 0) at the top left of the display window to (1, 1) at the bottom right, after the division by w.

Nuke's camera looks down -z. Scripts that make one of a header transpose worldToCamera, scale z by
-1 and invert. Nuke's focal length and apertures are pinholeFocalLength and sensorOverallDimensions,
and its win_translate, in halves of the width, is 2 screenWindowCenter / screenWindowWidth.

Source: OpenEXR's standard attributes worldToCamera, worldToNDC, screenWindowCenter and -Width,
pinholeFocalLength, sensorOverallDimensions, aperture and focus.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.images.layout import Entry, Metadata

USUAL_FOCAL_LENGTH = 50.0
"""Focal length of a camera that has a field of view but no lens, USD's default [mm]."""


def camera_metadata(
    *,
    world_to_camera: Sequence[float],
    window: tuple[float, float, float, float],
    orthographic: bool,
) -> Metadata:
    """Return the entries for `ImageLayout.metadata`.

    Args:
        world_to_camera: 16 numbers, row-major, for column vectors, of a USD camera, which looks
            down -Z with +Y up [scene unit].
        window: (left, bottom, right, top) of the display window: at distance 1 from the eye, or in
            scene units for an orthographic camera.
        orthographic: Whether the camera is orthographic.
    """
    left, bottom, right, top = window
    camera = np.reshape(np.asarray(world_to_camera, np.float64), (4, 4))
    entries: dict[str, Entry] = {
        "worldToCamera": _row_vectors(np.diag([1.0, 1.0, -1.0, 1.0]) @ camera),
        "worldToNDC": _row_vectors(_to_ndc(window, orthographic) @ camera),
        "usdsplat:projection": "orthographic" if orthographic else "perspective",
    }
    if not orthographic:
        entries["screenWindowCenter"] = ((left + right) / 2, (bottom + top) / 2)
        entries["screenWindowWidth"] = right - left
    return entries


def lens_metadata(
    *,
    window: tuple[float, float, float, float],
    focal_length: float,
    lens_radius: float,
    focus_distance: float,
    meters_per_unit: float,
) -> Metadata:
    """Return the entries on the lens and film back of a perspective camera.

    Args:
        window: As for `camera_metadata`. The film back is the part of it that the picture shows.
        focal_length: Focal length [scene unit]; 0 for a camera that has none. The entries then
            describe its field of view for `USUAL_FOCAL_LENGTH`.
        lens_radius: Radius of the entrance pupil [scene unit]; 0 for a pinhole.
        focus_distance: Planar depth in focus [scene unit]; 0 if there is none.
        meters_per_unit: Length of a scene unit [m].
    """
    left, bottom, right, top = window
    has_lens = focal_length > 0 and 0 < meters_per_unit < math.inf
    millimetres = 1000.0 * meters_per_unit * focal_length if has_lens else USUAL_FOCAL_LENGTH
    entries: dict[str, Entry] = {
        "pinholeFocalLength": millimetres,
        "sensorOverallDimensions": (millimetres * (right - left), millimetres * (top - bottom)),
    }
    if has_lens and lens_radius > 0:
        entries["aperture"] = focal_length / (2.0 * lens_radius)
    if has_lens and focus_distance > 0:
        entries["focus"] = meters_per_unit * focus_distance
    return entries


def _to_ndc(window: tuple[float, float, float, float], orthographic: bool) -> F64:
    """Return the matrix from camera space to NDC, column vectors; row z keeps it invertible."""
    left, bottom, right, top = window
    width, height = right - left, top - bottom
    if orthographic:
        rows = [[1 / width, 0, 0, -left / width], [0, -1 / height, 0, top / height]]
        return np.array([*rows, [0, 0, -1, 0], [0, 0, 0, 1]], np.float64)
    rows = [[1 / width, 0, left / width, 0], [0, -1 / height, -top / height, 0]]
    return np.array([*rows, [0, 0, 0, 1], [0, 0, -1, 0]], np.float64)


def _row_vectors(matrix: F64) -> tuple[float, ...]:
    """Convert a matrix for column vectors to EXR's form."""
    return tuple(matrix.T.ravel().tolist())
