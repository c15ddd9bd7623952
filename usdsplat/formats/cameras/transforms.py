"""Read `transforms.json` of the original NeRF data sets, instant-ngp and nerfstudio.

Poses are stored from camera to world, with camera axes x right, y up, z back. Intrinsics stand at
the top level or with each frame; those of the frame take precedence. nerfstudio transforms COLMAP's
world before it writes the file (`applied_transform`), and transforms and scales it again in
training. If its `dataparser_transforms.json` stands beside the file, the cameras are transformed
accordingly, because captures trained by nerfstudio are in that space.

Source: instant-ngp, docs/nerf_dataset_tips.md; nerfstudio, "Data conventions" in its documentation.
"""

from __future__ import annotations

import math
from collections import ChainMap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError
from usdsplat.core.progress import Progress
from usdsplat.formats.cameras.lens import Lens, lens
from usdsplat.formats.cameras.posed import CameraSet, Posed, carried, checked_count
from usdsplat.formats.json_values import a_list, an_object, parse_object, show

NAME = "transforms.json"
TRAINED = "dataparser_transforms.json"
"""Transformation applied by nerfstudio's training, written beside its results."""

_MOST_BYTES = 12 << 20
"""Limit of the file size, about ten thousand frames; parsed JSON takes up to thirty times its size
in memory."""
_LARGEST = 1e12
_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Convert camera axes: x right, y down, z forward to x right, y up, z back."""
_BEFORE = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]
"""`applied_transform` that older nerfstudio applied to COLMAP models without recording it."""
_MODELS = (
    *("OPENCV", "PERSPECTIVE", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"),
    "OPENCV_FISHEYE",
)
"""Accepted values of `camera_model`; the coefficients determine the lens model."""
_FISHEYE = ("k1", "k2", "k3", "k4")
_FLAT = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Coefficients, in the order of COLMAP's parameters."""


def read(path: Path, progress: Progress) -> CameraSet:
    """Read the cameras of a `transforms.json`.

    Raises:
        FormatError: If it is not a `transforms.json`, or cannot be opened.
    """
    top = _load(path)
    frames = a_list(f"{path}: frames", top.get("frames"))
    checked_count(f"{path}: frames", len(frames))
    trained, notes = _training(path, top)
    found = []
    for index, frame in enumerate(frames):
        where = f"{path}: frame {index}"
        frame = dict(an_object(where, frame))
        name = frame.get("file_path")
        name = name if isinstance(name, str) and name else f"frame_{index:05d}"
        pose = _pose(f"{where}: transform_matrix", frame.get("transform_matrix"))
        to_capture = carried(pose @ _OPENCV, trained)
        # ChainMap avoids a copy of the top level for each of up to 100,000 frames.
        taken = _lens(where, ChainMap(frame, top), path.parent / name)
        found.append(Posed(name=name.removeprefix("./"), lens=taken, to_capture=to_capture))
    progress.step("reading cameras", len(found), len(found))
    files = (path, path.with_name(TRAINED)) if path.with_name(TRAINED).is_file() else (path,)
    return CameraSet(format=NAME, files=files, cameras=tuple(found), notes=notes)


def _load(path: Path) -> dict[str, Any]:
    """Read the JSON object in a file."""
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
    except OSError as error:
        said = (error.strerror or str(error)).lower()
        raise FormatError(str(path), said, "a readable file") from error
    if len(text) > _MOST_BYTES:
        raise FormatError(str(path), f"more than {_MOST_BYTES} bytes", "fewer")
    return dict(parse_object(str(path), text))


def _training(path: Path, top: Mapping[str, Any]) -> tuple[F64, tuple[str, ...]]:
    """Return the matrix from the file's world to the capture's, and the assumptions made."""
    beside = path.with_name(TRAINED)
    applied = top.get("applied_transform")
    if not beside.is_file():
        if applied is None:
            return np.eye(4), ()
        note = (
            f"the capture is assumed to have the coordinates of {path.name}, not in COLMAP's: "
            "there is an "
            f"applied_transform and no {TRAINED} beside it"
        )
        return np.eye(4), (note,)
    if applied is None and (path.parent / "colmap/sparse/0").is_dir():
        applied = _BEFORE
    before = np.eye(4) if applied is None else _pose(f"{path}: applied_transform", applied)
    after = _load(beside)
    matrix = _pose(f"{beside}: transform", after.get("transform"))
    scale = _number(f"{beside}: scale", after.get("scale", 1.0))
    if scale <= 0:
        raise FormatError(f"{beside}: scale", f"{scale:g}", "a positive number")
    # `transform` starts from COLMAP's world, before `applied_transform`.
    note = f"the capture is assumed to have the coordinates of nerfstudio's training: {TRAINED}"
    return np.diag([scale, scale, scale, 1.0]) @ matrix @ np.linalg.inv(before), (note,)


def _pose(where: str, value: Any) -> F64:
    """Read a rotation and a translation of 3 or 4 rows; a scale of the rotation is removed."""
    rows = value if isinstance(value, list) else []
    if len(rows) not in (3, 4) or not all(isinstance(r, list) and len(r) == 4 for r in rows):
        raise FormatError(where, show(value), "3 or 4 rows of 4 numbers")
    matrix = np.eye(4)
    for i, row in enumerate(rows[:3]):
        matrix[i] = [_number(where, item) for item in row]
    try:
        rigid = carried(np.eye(4), matrix)
    except ValueError:
        found = "a matrix that mirrors or shears"
        raise FormatError(where, found, "a rotation and a translation") from None
    u, _, v = np.linalg.svd(rigid[:3, :3])
    rigid[:3, :3] = u @ v
    return rigid


def _lens(where: str, of: Mapping[str, Any], picture: Path) -> Lens:
    """Return the intrinsics of a frame; if the file gives no size, it is read from the picture."""
    name = of.get("camera_model", "OPENCV_FISHEYE" if of.get("is_fisheye") is True else "OPENCV")
    if not isinstance(name, str) or name not in _MODELS:
        raise FormatError(f"{where}: camera_model", show(name), f"one of {', '.join(_MODELS)}")
    if "w" in of and "h" in of:
        width, height = (_number(f"{where}: {side}", of[side]) for side in "wh")
    else:
        width, height = _size(where, picture)
    fx, fy = _focal(where, of, "x", width), _focal(where, of, "y", height)
    fx = fy if fx is None else fx  # a single focal length holds for both axes
    fy = fx if fy is None else fy
    if fx is None or fy is None:
        raise FormatError(where, "no fl_x and no camera_angle_x", "one of them")
    cx = _number(f"{where}: cx", of.get("cx", 0.5 * width))
    cy = _number(f"{where}: cy", of.get("cy", 0.5 * height))
    names = _FISHEYE if name == "OPENCV_FISHEYE" else _FLAT
    bent = [_number(f"{where}: {key}", of.get(key, 0.0)) for key in names]
    model, values = _model(name, bent)
    return lens(where, model, (round(width), round(height)), [fx, fy, cx, cy, *values])


def _model(name: str, bent: list[float]) -> tuple[str, list[float]]:
    """Return the simplest COLMAP model that has all nonzero coefficients, and its coefficients."""
    if name == "OPENCV_FISHEYE":
        return name, bent
    if any(bent[4:]):
        return "FULL_OPENCV", bent
    return ("OPENCV", bent[:4]) if any(bent) else ("PINHOLE", [])


def _focal(where: str, of: Mapping[str, Any], axis: str, side: float) -> float | None:
    """Return a focal length [pixel], given directly or as a field of view, or None."""
    if of.get(f"fl_{axis}") is not None:
        return _number(f"{where}: fl_{axis}", of[f"fl_{axis}"])
    if of.get(f"camera_angle_{axis}") is None:
        return None
    angle = _number(f"{where}: camera_angle_{axis}", of[f"camera_angle_{axis}"])
    if not 0 < angle < math.pi:
        raise FormatError(f"{where}: camera_angle_{axis}", f"{angle:g}", "0 to pi")
    return 0.5 * side / math.tan(0.5 * angle)


def _size(where: str, picture: Path) -> tuple[float, float]:
    """Read the size of a picture [pixel] from its header; names may lack ".png"."""
    from PIL import Image

    try:
        for path in (picture, Path(f"{picture}.png")):
            if path.is_file():
                with Image.open(path) as image:
                    return float(image.width), float(image.height)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        found = f"a picture that cannot be read, {str(picture)[-80:]!r}"
        raise FormatError(where, found, "w and h, or a picture") from error
    raise FormatError(where, f"no w and h, and no file {str(picture)[-80:]!r}", "a size in pixels")


def _number(where: str, value: Any) -> float:
    """Return `value` if it is a finite JSON number."""
    if type(value) not in (int, float) or not abs(value) < _LARGEST:
        raise FormatError(where, show(value), "a finite number")
    return float(value)
