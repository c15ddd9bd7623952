"""Copy a stage or a capture with everything that it refers to into a folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from pxr import Sdf, UsdUtils

from usdsplat.core.errors import OutputError, StageError
from usdsplat.interchange.files import capture_files, is_usd
from usdsplat.interchange.sequence_files import files_of, is_sequence
from usdsplat.schema.usd_files import export_layer


def localize(source: Path, folder: Path, frames: Sequence[float] | None = None) -> Path:
    """Copy a stage with its layers and assets, or a capture, and return the path of the copy.

    Paths in the copied layers lead to the copied files, so that the folder can be moved.

    Args:
        source: The stage or capture, or the name of a sequence of captures.
        folder: Folder for the copies, which does not exist.
        frames: Those of a sequence; None for all.

    Raises:
        OutputError: If the folder exists, or a file cannot be written.
        StageError: If a layer or an asset cannot be copied.
    """
    if folder.exists():
        raise OutputError(str(folder), "a folder that exists", "a new one")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise OutputError(str(folder), found, "a place for a folder") from error
    try:
        target = folder / source.name
        if not is_usd(source) or source.suffix == ".usdz":
            for file in _captures(source, frames):
                inside = target if file.name == source.name else _beside(target, source, file)
                inside.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, inside)
        elif not UsdUtils.LocalizeAsset(str(source), str(folder), False) or not target.is_file():
            raise StageError(str(source), "files that cannot be copied", "a stage without errors")
        else:
            _anchor(folder)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            found = (error.strerror or str(error)).lower()
            expected = f"what can be copied to {folder}"
            raise OutputError(str(source), found, expected) from error
        raise
    return target


def _captures(source: Path, frames: Sequence[float] | None) -> list[Path]:
    """Return the files of a capture, or of a sequence of captures."""
    if is_sequence(source):
        return [path.absolute() for path in files_of(source, frames).values()]
    return list(map(Path, capture_files(source) or [str(source)]))


def _beside(target: Path, source: Path, file: Path) -> Path:
    """Return the copy of a file that lies in the folder of a source, or below."""
    return target.parent / file.relative_to(source.absolute().parent)


def _anchor(folder: Path) -> None:
    """Make the paths of copied layers relative to the layers themselves.

    `UsdUtils` writes paths in the folder, which USD finds only while a layer of the folder is the
    root layer. A bake that has the copied stage as a sublayer is another one.
    """
    for file in sorted(folder.rglob("*")):
        if not is_usd(file) or file.suffix == ".usdz" or not file.is_file():
            continue
        layer = Sdf.Layer.OpenAsAnonymous(str(file))
        moved: list[str] = []

        def anchored(path: str, file: Path = file, moved: list[str] = moved) -> str:
            there = path.replace("<UDIM>", "1001")
            if not path or (file.parent / there).exists() or not (folder / there).exists():
                return path
            moved.append(path)
            return os.path.relpath(folder / path, file.parent)

        UsdUtils.ModifyAssetPaths(layer, anchored)
        if moved:
            export_layer(layer, file)
