"""Make a stage that is ready for simulation, from a capture or from a stage with one field."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

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
) -> list[Path]:
    """Write a stage in which a capture is simulated.

    Args:
        preset: Name of a preset.
        source: A capture, which is imported into a .usdc beside the target, or a stage with one
            splat field, which the target refers to.
        target: A .usda or .usdc file that does not exist yet. A missing folder is made.
        axes: Directions of a capture's x, y and z; None to use the file's own.
        progress: Receives the progress of the import.
        options: Values of the presets' options by name, see `author_preset`.

    Returns:
        The files that were written, the target last.

    Raises:
        UsageError: If the preset does not exist or does not take an option or its value, or `axes`
            is given for a stage.
        OutputError: If the target exists or cannot be written.
    """
    given = dict(options or {})
    find_preset(preset, where="--preset").chosen(given)
    check_suffix(target)
    check_not_input(target, [source])
    if target.exists():
        raise OutputError(str(target), "a file", "a new name")
    with made_folder(target.parent):
        return _make(preset, source, target, axes=axes, progress=progress, options=given)


def _make(
    name: str,
    source: Path,
    target: Path,
    *,
    axes: str | None,
    progress: Progress,
    options: Mapping[str, str | None],
) -> list[Path]:
    """Write the files of a stage; see `make_stage`."""
    if is_usd(source):
        if axes is not None:
            raise UsageError("--axes", "a stage, which defines its own axes", "a capture")
        author_preset(name, open_stage(source), target, options=options)
        return [target]
    capture = target.with_name(f"{target.stem}_capture.usdc")
    if capture.exists():
        raise OutputError(str(capture), "a file", f"no such file, because {target} needs this name")
    import_capture(source, capture, options=ImportOptions(axes=axes), progress=progress)
    try:
        author_preset(name, open_stage(capture), target, options=options)
    except BaseException:
        capture.unlink(missing_ok=True)
        raise
    return [capture, target]
