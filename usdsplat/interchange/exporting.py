"""Splat fields of a stage become one capture file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import formats, schema
from usdsplat.core import axes, edit
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange import files
from usdsplat.interchange.placement import checked_path, stage_frame
from usdsplat.interchange.reports import ExportReport

_PURPOSES = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)


def export_capture(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    prim_path: str | None = None,
    time: float | None = None,
    frame: str | None = None,
    progress: Progress = silent,
) -> ExportReport:
    """Write splat fields as a capture: merged, in world space, turned to the capture's axes.

    Transforms are applied exactly, harmonics included. Lengths stay in the stage's unit.

    Args:
        source: A USD file, or a stage, which is not changed.
        target: A file of a format that `formats` writes, replaced when the new one is complete.
        prim_path: A field, or a prim with fields beneath it; None is the whole stage. What is
            invisible or of purpose proxy or guide is left out, unless it is the prim named here.
        time: Time code; None is the default value, or the first sample where there is none.
        frame: Where x, y and z of the file are to point, such as "rdf"; None is its format's way.
        progress: Told about each field and about writing.

    Raises:
        StageError: If the source cannot be opened, or there is no field to write.
        UsageError: If `frame` names no frame.
        UnknownFormatError: If the target's suffix is none that can be written.
        OutputError: If the target cannot be written, or belongs to the source.
    """
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(Path(source))
    path = Path(target)
    files.check_not_input(path, files.layer_files(stage))
    frame = frame or formats.frame_written(path)
    turn = axes.change(stage_frame(stage), frame)
    prims, notes = _appearances(stage, prim_path, time)
    clouds = []
    for done, prim in enumerate(prims):
        progress.step("reading fields", done, len(prims))
        clouds.append(_in_world(prim, turn, time))
    progress.step("reading fields", len(prims), len(prims))
    cloud = clouds[0] if len(clouds) == 1 else edit.merge(clouds)
    is_antialiased = all(schema.rasterize_mode(prim) == "antialiased" for prim in prims)
    how = formats.Writing(antialiased=is_antialiased, frame=frame)
    formats.write(cloud, path, how=how, progress=progress)
    return ExportReport(
        source=stage.GetRootLayer().identifier if isinstance(source, Usd.Stage) else str(source),
        target=str(path),
        prim_paths=tuple(str(prim.GetPath()) for prim in prims),
        splats=len(cloud),
        degree=cloud.sh_degree,
        frame=frame,
        notes=(*files.composition_remarks(stage), *notes, *_losses(prims, cloud)),
    )


def _appearances(
    stage: Usd.Stage, prim_path: str | None, time: float | None
) -> tuple[list[Usd.Prim], list[str]]:
    """Fields that can be seen, instances each for themselves, and notes on what is left out."""
    root = (
        stage.GetPseudoRoot() if prim_path is None else stage.GetPrimAtPath(checked_path(prim_path))
    )
    if not root:
        raise StageError(str(prim_path), "no such prim", "a splat field of the stage")
    if schema.is_splat_field(root):
        return [root], []
    found, notes = [], []
    prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            notes.append(f"{prim.GetPath()}: point instances are not exported")
            prims.PruneChildren()
        elif schema.is_splat_field(prim):
            if _is_visible(prim, time):
                found.append(prim)
            else:
                notes.append(f"{prim.GetPath()}: left out, it is not shown in renders")
    if not found:
        where = prim_path or stage.GetRootLayer().identifier
        raise StageError(where, "; ".join(notes) or "no splat field", "one that can be seen")
    return found, notes


def _is_visible(prim: Usd.Prim, time: float | None) -> bool:
    """Whether renders show the prim."""
    imageable = UsdGeom.Imageable(prim)
    if imageable.ComputePurpose() not in _PURPOSES:
        return False
    return bool(imageable.ComputeVisibility(_code(time)) != UsdGeom.Tokens.invisible)


def _in_world(prim: Usd.Prim, turn: F64, time: float | None) -> SplatCloud:
    """The splats of one appearance in world space, its axes turned by `turn`."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    to_world = UsdGeom.XformCache(_code(time)).GetLocalToWorldTransform(prim)
    matrix = matrix @ np.array(to_world).T  # Gf's vectors are rows
    cloud = schema.fetch(prim, time)
    return cloud if np.array_equal(matrix, np.eye(4)) else edit.transform(cloud, matrix)


def _losses(prims: list[Usd.Prim], cloud: SplatCloud) -> list[str]:
    """What capture files cannot say."""
    notes = unknown_color_spaces(prims)
    spaces = sorted({schema.color_space(prim) for prim in prims})
    if spaces != [schema.tokens.DEFAULT_COLOR_SPACE]:
        listed = " and ".join(spaces)
        notes.append(f"colours are numbers in {listed}, which the file does not say")
    if len({schema.rasterize_mode(prim) for prim in prims}) > 1:
        notes.append("fields are rasterised differently; the file says classic for all")
    for name in ("ids", "velocities"):
        if getattr(cloud, name) is not None:
            notes.append(f"{name} are not written")
    return notes


def unknown_color_spaces(prims: list[Usd.Prim]) -> list[str]:
    """A sentence for each field whose colours nobody can read."""
    return [
        f"{prim.GetPath()}: found colour space {schema.color_space(prim)!r}, expected one that USD "
        "knows; the field is not drawn"
        for prim in prims
        if not schema.is_known_color_space(schema.color_space(prim))
    ]


def _code(time: float | None) -> Usd.TimeCode:
    return Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
