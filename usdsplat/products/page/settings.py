"""Make the viewer's settings (`settings.json`, version 2) of a camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.products.page.camera import PageCamera

DIGITS = 7
"""Significant digits of numbers."""
HELD = 1 - 1e-3
"""Part of a frame for which the last pose is held before an animation starts anew."""
_NO_EFFECTS = {
    "sharpness": {"enabled": False, "amount": 0},
    "bloom": {"enabled": False, "intensity": 0.1, "blurLevel": 2},
    "grading": {
        "enabled": False,
        "brightness": 1,
        "contrast": 1,
        "saturation": 1,
        "tint": [1, 1, 1],
    },
    "vignette": {"enabled": False, "intensity": 0.5, "inner": 0.3, "outer": 0.75, "curvature": 1},
    "fringing": {"enabled": False, "intensity": 0.5},
}


def viewer_settings(camera: PageCamera) -> tuple[dict[str, Any], list[float]]:
    """Return the settings, and the up vectors of the camera's keyframes, 3 numbers each.

    Colours are drawn as captured: without tone mapping and effects. An animation repeats. If its
    end is near its beginning, as in a turntable, the camera moves on between them; else it jumps.
    """
    start = camera.start
    initial = {
        "position": _listed(camera.positions[start]),
        "target": _listed(camera.targets[start]),
        "fov": _listed(camera.fovs[start : start + 1])[0],
    }
    ups, tracks = camera.ups[start], []
    if len(camera.frames) > 1:
        track, ups = _track(camera)
        tracks = [track]
    settings = {
        "version": 2,
        "tonemapping": "none",
        "highPrecisionRendering": False,
        "background": {"color": list(camera.background)},
        "postEffectSettings": _NO_EFFECTS,
        "animTracks": tracks,
        "cameras": [{"initial": initial}],
        "annotations": [],
        "startMode": "animTrack" if tracks else "default",
    }
    return settings, _listed(ups)


def _track(camera: PageCamera) -> tuple[dict[str, Any], F64]:
    """Return the animation as a track of the viewer, and its up vectors."""
    times = np.array(camera.frames) - camera.frames[0]
    step = float(np.diff(times).min())
    order = np.arange(len(times))
    if not _is_closed(camera):
        times, order = np.append(times, times[-1] + HELD * step), np.append(order, order[-1])
    duration = (float(camera.frames[-1] - camera.frames[0]) + step) / camera.rate
    values = {
        "position": _listed(camera.positions[order]),
        "target": _listed(camera.targets[order]),
        "fov": _listed(camera.fovs[order]),
    }
    track = {
        "name": camera.path or "camera",
        "duration": duration,
        "frameRate": camera.rate,
        "loopMode": "repeat",
        "interpolation": "spline",
        "smoothness": 0,
        "keyframes": {"times": _listed(times), "values": values},
    }
    return track, camera.ups[order]


def _is_closed(camera: PageCamera) -> bool:
    """Return whether the last pose is as near to the first as two frames at the camera's highest
    speed."""
    poses = np.hstack([camera.positions, camera.targets])
    times = np.diff(camera.frames)
    speeds = np.linalg.norm(np.diff(poses, axis=0), axis=1) / times
    return bool(np.linalg.norm(poses[0] - poses[-1]) <= 2 * speeds.max() * times.min())


def _listed(values: F64) -> list[float]:
    """Return numbers as short as `DIGITS` allow, flat."""
    return [float(f"{value:.{DIGITS}g}") for value in np.ravel(values)]
