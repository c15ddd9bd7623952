"""Make a stage that is ready for simulation, from a capture or from a stage with one field."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf

from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.progress import Progress
from usdsplat.interchange.files import check_not_input, check_suffix, is_usd, open_stage
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import ImportOptions
from usdsplat.sim.stage.presets import author_preset, find_preset


def make_stage(
    preset: str,
    source: Path,
    target: Path,
    *,
    axes: str | None,
    progress: Progress,
    options: Mapping[str, str | None] | None = None,
    edits: Sdf.Layer | None = None,
) -> list[Path]:
    """Write a stage in which a capture is simulated.

    Args:
        preset: Name of a preset.
        source: A capture, which is imported into a .usdc beside the target, or a stage with one
            splat field, which the target refers to.
        target: A .usda or .usdc file that does not exist yet. A missing folder is made.
        axes: Directions of a capture's x, y and z; None to use the file's own.
        progress: Receives the progress of the import.
        options: Values of the presets' options by name, see `author_preset`; the target is the path
            of a stage, or of a capture, which is imported beside the preset's stage too.
        edits: Opinions over the source's that the new stage takes over, see `author_preset`.

    Returns:
        The files that were written, the target last.

    Raises:
        UsageError: If the preset does not exist or does not take an option or its value, or `axes`
            is given for a stage.
        OutputError: If the target exists or cannot be written.
    """
    given = dict(options or {})
    find_preset(preset, where="--preset").chosen(given)
    file = given.pop("target", None)
    goal = None if file is None else Path(file)
    check_suffix(target)
    check_not_input(target, [source] if goal is None else [source, goal])
    if target.exists():
        raise OutputError(str(target), "a file", "a new name")
    with made_folder(target.parent):
        made: list[Path] = []
        try:
            if is_usd(source) and axes is not None:
                raise UsageError("--axes", "a stage, which defines its own axes", "a capture")
            capture = _stage_of(source, target, "capture", axes, progress, made)
            there = None
            if goal is not None:
                there = open_stage(_stage_of(goal, target, "target", None, progress, made))
            author_preset(
                preset, open_stage(capture), target, options=given, goal=there, edits=edits
            )
        except BaseException:
            for path in made:
                path.unlink(missing_ok=True)
            raise
        return [*made, target]


def _stage_of(
    source: Path, target: Path, name: str, axes: str | None, progress: Progress, made: list[Path]
) -> Path:
    """Return a stage, or that which a capture is imported to beside the target, which is added to
    `made`."""
    if is_usd(source):
        return source
    file = target.with_name(f"{target.stem}_{name}.usdc")
    if file.exists():
        raise OutputError(str(file), "a file", f"no such file, because {target} needs this name")
    import_capture(source, file, options=ImportOptions(axes=axes), progress=progress)
    made.append(file)
    return file
