"""Any file that holds splats to any other, chosen by their suffixes."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from usdsplat import formats
from usdsplat.core import axes, edit
from usdsplat.core.errors import OutputError, UnknownFormatError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange import files
from usdsplat.interchange.exporting import export_capture
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import ExportReport, ImportReport, RepackReport
from usdsplat.schema import Form

Report = ImportReport | ExportReport | RepackReport


def convert(
    source: Path | str,
    target: Path | str,
    *,
    form: Form = "float",
    frame: str | None = None,
    up_axis: str | None = None,
    meters_per_unit: float | None = None,
    prim_path: str | None = None,
    bake_axes: bool = False,
    time: float | None = None,
    progress: Progress = silent,
) -> Report:
    """Turn a capture into a stage, a stage into a capture, or either into another of its kind.

    Args:
        source: A capture or a USD file.
        target: A capture or a USD file, replaced when the new one is complete.
        form: Of fields in a USD target.
        frame: Where x, y and z of the capture file point: of the target if that is one, "rdf" if
            None; else of the source, which is believed if None.
        up_axis: See `import_capture`.
        meters_per_unit: See `import_capture`.
        prim_path: Of the field that is written to, or read from, a stage.
        bake_axes: See `import_capture`.
        time: See `export_capture`.
        progress: Told about each step.

    Raises:
        UsdSplatError: As `import_capture`, `export_capture` and `repack` say.
    """
    source, target = Path(source), check_target(target)
    if not files.is_usd(source) and files.is_usd(target):
        return import_capture(
            source,
            target,
            form=form,
            frame=frame,
            up_axis=up_axis,
            meters_per_unit=meters_per_unit,
            prim_path=prim_path,
            bake_axes=bake_axes,
            progress=progress,
        )
    if files.is_usd(source) and files.is_usd(target):
        return repack(source, target, form=form, progress=progress)
    if files.is_usd(source):
        return export_capture(
            source, target, prim_path=prim_path, time=time, frame=frame, progress=progress
        )
    return _between_captures(source, target, frame or formats.frame_written(target), progress)


def check_target(target: Path | str) -> Path:
    """The target as a path, if its name says what it is to become.

    Raises:
        UnknownFormatError: If it says nothing that can be written.
        OutputError: If it says that it is a folder.
    """
    path = Path(target)
    if str(target).endswith(os.sep):
        raise OutputError(str(target), "the name of a folder", "one of a file")
    known = (*formats.suffixes_written(), *files.SUFFIXES)
    if not path.name.lower().endswith(known):
        found = f"suffix {path.suffix!r}"
        raise UnknownFormatError(str(path), found, f"one of {', '.join(known)}")
    return path


def _between_captures(source: Path, target: Path, frame: str, progress: Progress) -> ExportReport:
    """One capture file as another."""
    files.check_not_input(target, [source])
    capture = formats.read(source, progress=progress)
    matrix = np.eye(4)
    matrix[:3, :3] = axes.change(capture.frame, frame)
    turned = not np.array_equal(matrix, np.eye(4))
    cloud = edit.transform(capture.cloud, matrix) if turned else capture.cloud
    how = formats.Writing(antialiased=capture.antialiased, frame=frame)
    formats.write(cloud, target, how=how, progress=progress)
    return ExportReport(
        source=str(source),
        target=str(target),
        prim_paths=(),
        splats=len(cloud),
        degree=cloud.sh_degree,
        frame=frame,
        notes=capture.notes,
    )
