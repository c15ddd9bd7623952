"""Import the cameras of photographs, beside the field that was trained from them.

USD cameras are pinholes: lens distortion is noted and stored in customData.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError, StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.core.wording import counted
from usdsplat.formats import cameras
from usdsplat.formats.cameras import Lens, Posed
from usdsplat.formats.cameras.posed import carried
from usdsplat.interchange.footprint import footprint
from usdsplat.interchange.placement import OP, identifier, placement
from usdsplat.interchange.provenance import KEY
from usdsplat.schema import DrawingHints, attributes, stock, tokens
from usdsplat.schema.stage_values import local_transform

SCOPE = "cameras"
"""Name of the scope of cameras, beside the field."""
APERTURE = 36.0
"""Horizontal aperture of every camera [tenth of a scene unit]: that of 36 mm film."""

_NEAREST = 0.01
"""Near plane of a camera, as a fraction of the median depth of the splats in front of it."""
_RANGE = 1e6
"""Maximum ratio of far to near plane, for depth buffers."""
_SHOWN = 0.5
"""Minimum difference between photograph and render that is noted [pixel]."""
_STEP = 64
_SAMPLED = 1 << 16
"""Maximum number of splat centres used for the clipping range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraReport:
    """Report on imported cameras."""

    source: str
    """File or folder of the poses."""
    format: str
    """"COLMAP binary", "COLMAP text" or "transforms.json"."""
    prim_paths: tuple[str, ...]
    """Prim paths, one for each photograph, in the order of the file."""
    notes: tuple[str, ...] = ()
    """Findings that a user should know, one sentence each."""


def import_cameras(
    source: Path | str,
    field: Usd.Prim,
    *,
    frame: str = "rdf",
    meters_per_unit: float | None = None,
    edited: F64 | None = None,
    progress: Progress = silent,
) -> CameraReport:
    """Author a camera for each photograph of a capture, in a scope "cameras" beside its field.

    Apart from lens distortion, a point has the same pixel in the photograph and in a render of the
    photograph's size. customData["usdsplat"] of a camera has `image`, `width`, `height`, the lens
    and its distortion.

    Args:
        source: See `formats.cameras.read`.
        field: Field of the capture, on a stage whose edit target is written.
        frame: Axes of the capture, as given to its import; ignored if the field has the transform
            op of its import.
        meters_per_unit: Metres per unit of the capture; ignored in the same case.
        edited: Transformation of the capture between training and import, shape (4, 4), column
            vectors: a rotation, a uniform scale and a translation.
        progress: Receives the progress of reading and authoring.

    Raises:
        FormatError: If the source is invalid, or single precision cannot hold a camera.
        UsageError: If `frame` or `edited` mirrors or shears, which a camera cannot.
        StageError: If the field's own transform mirrors or shears.
    """
    found = cameras.read(source, progress=progress)
    matrix = _to_parent(field, frame, meters_per_unit, edited)
    stage = field.GetStage()
    group = _free(stage, field.GetPath().GetParentPath().AppendChild(SCOPE))
    UsdGeom.Scope.Define(stage, group)
    centres = _centres(field)
    splats = np.concatenate([centres, _corners(field)])
    names = _names([camera.name for camera in found.cameras])
    paths = [group.AppendChild(name) for name in names]
    poses = [carried(camera.to_capture, matrix) for camera in found.cameras]
    ranges = [_clipping_range(pose, splats) for pose in poses]
    for camera, pose, clipping in zip(found.cameras, poses, ranges, strict=True):
        _check_finite(f"{source}: {camera.name[:80]}", camera.lens, pose, clipping)
    for done, (camera, path) in enumerate(zip(found.cameras, paths, strict=True)):
        if done % _STEP == 0:
            progress.step("authoring cameras", done, len(paths))
        _author(stage, path, camera, poses[done], ranges[done])
    progress.step("authoring cameras", len(paths), len(paths))
    lenses = [camera.lens for camera in found.cameras]
    size = footprint(list(zip(lenses, poses, strict=True)), centres)
    if size is not None:
        size /= float(np.cbrt(np.linalg.det(_local(field)[:3, :3])))
        DrawingHints(footprint=size).author(field)
    notes = (*found.notes, *_about_lenses(lenses))
    return CameraReport(
        source=str(source), format=found.format, prim_paths=tuple(map(str, paths)), notes=notes
    )


def _to_parent(
    field: Usd.Prim, frame: str, meters_per_unit: float | None, edited: F64 | None
) -> F64:
    """Return the matrix from the capture's coordinates to the field's parent space."""
    matrix = _local(field)
    if not field.HasAttribute(OP):  # axes were baked, or needed no change
        turn = placement(field.GetStage(), frame, meters_per_unit).matrix
        _check(turn, UsageError("frame", f"{frame!r}, which is left-handed", "a right-handed one"))
        matrix = matrix @ turn
    where = f"{field.GetPath()}"
    expected = "a rotation, a translation and a uniform scale, which also apply to cameras"
    _check(matrix, StageError(where, "a transform that mirrors or shears", expected))
    if edited is not None:
        wrong = UsageError("edited", "a matrix that mirrors or shears", "a similarity")
        _check(edited, wrong)
        matrix = matrix @ edited
    return matrix


def _check(matrix: F64, error: Exception) -> None:
    """Raise the error if the matrix is not a similarity."""
    try:
        carried(np.eye(4), matrix)
    except ValueError:
        raise error from None


def _check_finite(where: str, lens: Lens, pose: F64, clipping: tuple[float, float]) -> None:
    """Raise an error for a camera with a number that USD's single precision cannot hold.

    Raises:
        FormatError: If there is one.
    """
    focal = lens.fx * APERTURE / lens.width
    ratios = (lens.height / lens.fy, (lens.width / 2 - lens.cx) / lens.fx)
    height = (lens.cy - lens.height / 2) / lens.fy
    numbers = (focal, focal * ratios[0], focal * ratios[1], focal * height, *clipping)
    with np.errstate(over="ignore"):
        single = np.array([*numbers, *pose.ravel()], np.float64).astype(np.float32)
    if not np.isfinite(single).all():
        found = "numbers beyond the range of single precision"
        raise FormatError(where, found, "a camera of the size of the capture")


def _author(
    stage: Usd.Stage, path: Sdf.Path, posed: Posed, pose: F64, clipping: tuple[float, float]
) -> None:
    """Author a camera; apertures have the unit of the focal length, so only ratios matter."""
    lens = posed.lens
    focal = lens.fx * APERTURE / lens.width
    camera = UsdGeom.Camera.Define(stage, path)
    looking_back = pose @ np.diag([1.0, -1.0, -1.0, 1.0])  # USD's cameras have y up and z back
    camera.AddTransformOp().Set(Gf.Matrix4d(looking_back.T.tolist()))
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.CreateFocalLengthAttr(focal)
    camera.CreateHorizontalApertureAttr(APERTURE)
    camera.CreateVerticalApertureAttr(focal * lens.height / lens.fy)
    camera.CreateHorizontalApertureOffsetAttr(focal * (lens.width / 2 - lens.cx) / lens.fx)
    camera.CreateVerticalApertureOffsetAttr(focal * (lens.cy - lens.height / 2) / lens.fy)
    camera.CreateClippingRangeAttr(Gf.Vec2f(*clipping))
    camera.GetPrim().SetCustomDataByKey(KEY, _remembered(posed))


def _remembered(posed: Posed) -> dict[str, object]:
    """Return metadata of the photograph, for comparing it with a render."""
    lens = posed.lens
    return {
        "image": posed.name,
        "width": lens.width,
        "height": lens.height,
        "lens": {
            "model": lens.model,
            "focalLength": Gf.Vec2d(lens.fx, lens.fy),
            "principalPoint": Gf.Vec2d(lens.cx, lens.cy),
            **({"distortion": dict(lens.distortion)} if lens.distortion else {}),
        },
    }


def _centres(field: Usd.Prim) -> F64:
    """Return some splat centres of a field in its parent space, shape (n, 3)."""
    code = Usd.TimeCode.EarliestTime()
    packed = schema.is_packed(field)
    name = tokens.POSITIONS if packed else stock.source_name(field, tokens.POSITIONS)
    found = attributes.array(field, name, code)
    centres = np.empty((0, 3)) if found is None else found
    return _in_parent(field, centres[:: max(1, -(-len(centres) // _SAMPLED))])


def _corners(field: Usd.Prim) -> F64:
    """Return the corners of a field's extent in its parent space: eight, or none without one."""
    code = Usd.TimeCode.EarliestTime()
    box = np.asarray(field.GetAttribute(tokens.EXTENT).Get(code) or ())
    corners = np.array(np.meshgrid(*box.T)).reshape(3, 8).T if box.shape == (2, 3) else ()
    return _in_parent(field, np.reshape(corners, (-1, 3)))


def _local(field: Usd.Prim) -> F64:
    """Return the transform to the parent space, shape (4, 4), for column vectors."""
    return np.array(local_transform(field, Usd.TimeCode.Default())).T


def _in_parent(field: Usd.Prim, points: npt.ArrayLike) -> F64:
    """Return the finite ones of some points of a field, in its parent space, shape (n, 3)."""
    matrix, found = _local(field), np.asarray(points, np.float64)
    found = found[np.isfinite(found).all(axis=1)]
    return np.asarray(found @ matrix[:3, :3].T + matrix[:3, 3])


def _clipping_range(pose: F64, points: F64) -> tuple[float, float]:
    """Return near and far planes around everything in front of a camera, except very near
    splats."""
    depths = (points - pose[:3, 3]) @ pose[:3, 2]
    depths = depths[depths > 0]
    if not len(depths):
        return 0.01, 1e4  # nothing is in front of it
    far = 1.01 * float(depths.max())
    return max(_NEAREST * float(np.median(depths)), far / _RANGE), far


def _names(images: Sequence[str]) -> list[str]:
    """Return a unique prim name for each image, which may be in folders."""
    taken: set[str] = set()
    next_number: dict[str, int] = {}  # linear time: a thousand folders may have a 0001.jpg
    names = []
    for image in images:
        stem = image.rpartition(".")[0] or image
        name = base = identifier(stem.strip("/") or "camera")
        while name in taken:
            next_number[base] = next_number.get(base, 0) + 1
            name = f"{base}_{next_number[base]}"
        taken.add(name)
        names.append(name)
    return names


def _free(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
    """Return the path, with a number appended if a prim exists there."""
    free, number = path, 1
    while stage.GetPrimAtPath(free):
        free, number = path.ReplaceName(f"{path.name}_{number}"), number + 1
    return free


def _about_lenses(lenses: Sequence[Lens]) -> list[str]:
    """Return notes on differences between renders and photographs."""
    notes = []
    bent = [lens for lens in lenses if not lens.is_pinhole]
    if bent:
        models = ", ".join(sorted({lens.model for lens in bent}))
        offsets = [lens.displacement for lens in bent]
        known = [offset for offset in offsets if offset is not None]
        some = "" if len(known) == len(bent) else ", for some by an unknown distance"
        most = f"up to {max(known):.3g} pixels{some}" if known else "an unknown distance"
        notes.append(
            f"{counted(len(bent), 'photograph')} of {len(lenses)} with lens distortion "
            f"({models}), which "
            f"renders do not have: they differ by {most}; the coefficients are in customData"
        )
    uneven = [lens for lens in lenses if lens.height * abs(lens.fx / lens.fy - 1) > _SHOWN]
    if uneven:
        most_uneven = max((lens.fx / lens.fy for lens in uneven), key=lambda ratio: abs(ratio - 1))
        notes.append(
            f"{counted(len(uneven), 'photograph')} of {len(lenses)} with pixels that are not "
            f"square (fx/fy is {most_uneven:.5g}): render them with the aspectRatioConformPolicy "
            "adjustPixelAspectRatio"
        )
    return notes
