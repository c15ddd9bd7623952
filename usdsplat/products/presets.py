"""Make a stage that is ready for simulation, from a capture or from a stage with one field."""

from __future__ import annotations

from pathlib import Path
from typing import cast, get_args

from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.progress import Progress
from usdsplat.interchange.files import check_not_input, check_suffix, is_usd, open_stage
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import ImportOptions
from usdsplat.sim.stage.presets import TARGETED, PresetName, author_preset


def make_stage(
    preset: str,
    source: Path,
    target: Path,
    *,
    axes: str | None,
    progress: Progress,
    goal: Path | None = None,
) -> list[Path]:
    """Write a stage in which a capture is simulated.

    Args:
        preset: One of `PresetName`.
        source: A capture, which is imported into a .usdc beside the target, or a stage with one
            splat field, which the target refers to.
        target: A .usda or .usdc file that does not exist yet. A missing folder is made.
        axes: Directions of a capture's x, y and z; None to use the file's own.
        progress: Receives the progress of the import.
        goal: What splats conform to or become: a stage, or a capture, which is imported beside the
            target too.

    Returns:
        The files that were written, the target last.

    Raises:
        UsageError: If the preset does not exist, or `axes` is given for a stage.
        OutputError: If the target exists or cannot be written.
    """
    if preset not in get_args(PresetName):
        raise UsageError("--preset", repr(preset), f"one of {', '.join(get_args(PresetName))}")
    check_suffix(target)
    if goal is not None and preset not in TARGETED:
        raise UsageError("--target", f"{goal}, and --preset {preset}", "--preset conform or morph")
    if goal is None and preset == "morph":
        raise UsageError("--target", "none, and --preset morph", "a capture to become")
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
            author_preset(cast(PresetName, preset), open_stage(capture), target, goal=there)
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
