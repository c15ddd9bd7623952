"""Writers of COLMAP models and `transforms.json`, from their definitions alone."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

NUMBERS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "OPENCV": 4, "OPENCV_FISHEYE": 5}
"""Models of COLMAP by their numbers in binary files."""


@dataclass(frozen=True)
class Shot:
    """A photograph by its world-to-camera pose, x right, y down, z forward."""

    name: str
    turn: tuple[float, float, float, float]
    """Quaternion (w, x, y, z)."""
    shift: tuple[float, float, float]
    camera: int = 1
    points: int = 3

    @property
    def rotation(self) -> np.ndarray:
        """The same as a matrix, by turning the unit axes."""
        w, *v = np.array(self.turn) / np.linalg.norm(self.turn)
        v = np.array(v)
        axes = np.eye(3)
        return np.stack([e + 2 * np.cross(v, np.cross(v, e) + w * e) for e in axes], axis=1)

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Points of the world as the camera has them."""
        return points @ self.rotation.T + np.array(self.shift)


Lens = tuple[str, int, int, Sequence[float]]
"""Model, width, height, parameters."""

SHOTS = (
    Shot("left/0001.jpg", (0.9, 0.1, -0.3, 0.2), (0.3, -0.2, 4.0)),
    Shot("a picture.png", (0.2, 0.7, 0.1, -0.4), (-0.5, 0.1, 5.0), camera=7, points=0),
)
LENSES = {
    1: ("PINHOLE", 640, 480, (500.0, 510.0, 300.0, 260.0)),
    7: ("OPENCV", 400, 300, (350.0, 350.0, 200.0, 150.0, 0.1, -0.05, 0.001, 0.002)),
}


def projected(shot: Shot, lens: Lens, points: np.ndarray) -> np.ndarray:
    """Where a pinhole with that lens' focal lengths has points of the world [pixel], (n, 2)."""
    x, y, z = shot.seen(points).T
    fx, fy, cx, cy = lens[3][:4]
    return np.stack([fx * x / z + cx, fy * y / z + cy], axis=1)


def colmap_text(
    folder: Path, shots: Sequence[Shot] = SHOTS, lenses: Mapping[int, Lens] = LENSES
) -> Path:
    """A model in text."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# Camera list with one line of data per camera:"]
    for number, (model, width, height, parameters) in lenses.items():
        numbers = " ".join(repr(float(value)) for value in parameters)
        lines.append(f"{number} {model} {width} {height} {numbers}")
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Image list with two lines of data per image:"]
    for number, shot in enumerate(shots, start=1):
        pose = " ".join(repr(float(value)) for value in (*shot.turn, *shot.shift))
        lines += [f"{number} {pose} {shot.camera} {shot.name}"]
        lines += [" ".join(["12.5 30.25 -1"] * shot.points)]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    return folder


def colmap_binary(
    folder: Path, shots: Sequence[Shot] = SHOTS, lenses: Mapping[int, Lens] = LENSES
) -> Path:
    """A model in binary."""
    folder.mkdir(parents=True, exist_ok=True)
    data = struct.pack("<Q", len(lenses))
    for number, (model, width, height, parameters) in lenses.items():
        data += struct.pack("<IiQQ", number, NUMBERS[model], width, height)
        data += struct.pack(f"<{len(parameters)}d", *parameters)
    (folder / "cameras.bin").write_bytes(data)
    data = struct.pack("<Q", len(shots))
    for number, shot in enumerate(shots, start=1):
        data += struct.pack("<I4d3dI", number, *shot.turn, *shot.shift, shot.camera)
        data += shot.name.encode() + b"\0" + struct.pack("<Q", shot.points)
        data += struct.pack("<ddQ", 12.5, 30.25, (1 << 64) - 1) * shot.points
    (folder / "images.bin").write_bytes(data)
    return folder


def transforms(path: Path, frames: Sequence[Mapping[str, Any]], **top: Any) -> Path:
    """A `transforms.json`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**top, "frames": list(frames)}))
    return path


def nerf_pose(shot: Shot, before: np.ndarray | None = None) -> list[list[float]]:
    """Camera to world with the camera's y up and z back; `before` (4, 4) turns the world first."""
    to_camera = np.eye(4)
    to_camera[:3, :3], to_camera[:3, 3] = shot.rotation, shot.shift
    matrix = np.linalg.inv(to_camera) @ np.diag([1, -1, -1, 1])
    return (matrix if before is None else before @ matrix).tolist()
