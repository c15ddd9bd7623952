"""Build splat trees: survey and sort the inputs, make chunks from the leaves up, write the stage.

Each step writes whole files into a `WorkFolder` and skips those that exist. A building that was
killed therefore continues, and its result is the same, bit for bit. Nothing depends on the number
of threads, or on how the inputs are divided into runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from usdsplat.core.errors import FormatError, OutputError, StageError, UsageError
from usdsplat.core.findings import Finding
from usdsplat.core.lock import output_lock
from usdsplat.core.node_table import NODE_SPLATS
from usdsplat.core.progress import Progress, silent
from usdsplat.core.sh import MAX_DEGREE
from usdsplat.core.wording import said_bytes
from usdsplat.interchange.lod.inputs import open_source
from usdsplat.interchange.lod.nodes import TreeStep
from usdsplat.interchange.lod.options import LOD, LodOptions, LodReport
from usdsplat.interchange.lod.partition import partition
from usdsplat.interchange.lod.placing import TreeFiles
from usdsplat.interchange.lod.runs import Runs, has_run
from usdsplat.interchange.lod.sorting import planned_runs, write_runs
from usdsplat.interchange.lod.tree_job import TreeJob
from usdsplat.interchange.lod.work_folder import WorkFolder
from usdsplat.interchange.placement import checked_unit
from usdsplat.kernels.devices import open_device

LEAST_LEAF, LEAST_MEMORY = 256, 768 << 20
"""Smallest size of leaves [splat], smallest limit of memory [byte]."""


def ignore_findings(_found: Iterable[Finding]) -> None:
    """Take no notice of findings, which are in the report too."""


def build_tree(
    sources: Path | str | Sequence[Path | str],
    target: Path | str,
    *,
    options: LodOptions = LOD,
    found: Callable[[Iterable[Finding]], None] = ignore_findings,
    progress: Progress = silent,
) -> LodReport:
    """Build a splat tree of captures and stages, merged in world space.

    `city.usda` has a prim `/city/splats` of the type ParticleFieldSplatTree; the splats are in
    layers in a folder `city_chunks` beside it. Beside the tree is an LOD root with coarse stock
    fields for other renderers. Files replace earlier ones when they are complete. A
    building that was interrupted or killed leaves the folder `.city.usda.building` and is continued
    by the next one with equal inputs and options.

    Args:
        sources: Captures in any format that `formats` reads, and stages, of which the visible
            fields are taken. The tree has the coordinates of the first.
        target: A .usd, .usda or .usdc file.
        options: Options.
        found: Receives the findings on the inputs before anything is written; it may raise.
        progress: Receives the progress of each step.

    Raises:
        FormatError: If a capture is invalid.
        StageError: If a stage cannot be opened, has no visible field, or there is no splat.
        UsageError: If an option is invalid, colour spaces differ, or an input does not fit in
            memory.
        OutputError: If a file cannot be written, or is an input.
    """
    paths = [Path(sources)] if isinstance(sources, Path | str) else [Path(s) for s in sources]
    _check(options)
    target = Path(target)
    TreeFiles.of(target, paths)
    inputs = [open_source(path, options) for path in paths]
    tree_files = TreeFiles.of(target, [file for each in inputs for file in each.files])
    findings = tuple(finding for each in inputs for finding in each.findings())
    found(findings)
    with output_lock(target):
        folder = WorkFolder(target, [file for each in inputs for file in each.files], options)
        try:
            job = TreeJob.prepared(inputs, folder, options, progress)
            report = job.build(tree_files, progress)
        except (FormatError, StageError, UsageError) as error:
            if not (folder.is_continued and isinstance(error, UsageError)):
                folder.remove()  # another attempt would fail too
            raise
        except BaseException:  # such as a full disk: another attempt continues
            folder.remove_if_empty()
            raise
        folder.remove()
    return replace(report, findings=findings)


def inspect(sources: Sequence[Path | str], *, options: LodOptions = LOD) -> list[Finding]:
    """Open the inputs of a tree that is built elsewhere, and return the findings on them.

    Args:
        sources, options: Those of `build_tree`.

    Raises:
        UsdSplatError: If an input cannot be opened, or an option is invalid.
    """
    _check(options)
    return [found for path in sources for found in open_source(Path(path), options).findings()]


def take_step(
    sources: Sequence[Path | str],
    target: Path,
    step: TreeStep,
    *,
    options: LodOptions = LOD,
    progress: Progress = silent,
) -> None:
    """Do a step of a building in parts.

    The first one surveys the inputs. Then all parts are sorted, and then built; other processes may
    do other parts meanwhile. `build_tree` does what is left. All steps need equal arguments.

    Args:
        sources, target, options, progress: Those of `build_tree`.
        step: The step.

    Raises:
        UsdSplatError: As `build_tree` does.
        OutputError: If no building was begun with these inputs and options, or it is not sorted.
    """
    if step.name == "begin":
        with output_lock(target):
            try:
                _opened_job(sources, target, options, progress)
            except (FormatError, StageError, UsageError):
                WorkFolder.remove_of(target)  # another attempt would fail too
                raise
        return
    part = step.part
    with output_lock(target.with_name(f"{target.name}.{part.number}-{part.count}")):
        job = _opened_job(sources, target, options, progress, is_begun=True)
        runs = planned_runs(job.surveys, job.meeting, job.folder, options.memory_limit)
        if step.name == "sort":
            taken = {path: rows for i, (path, rows) in enumerate(runs.items()) if part.takes(i)}
            write_runs(taken, job.inputs, job.meeting, progress)
            return
        if not all(map(has_run, runs)):
            raise OutputError(str(target), "a building whose splats are not sorted", _SORTED)
        found = Runs(list(runs), job.meeting.degree)
        if found.counts.sum():
            root = partition(found, options.leaf_splats)
            found.unmap()
            stage, _ = job.stage()
            job.builder(found, root, stage, open_device(task="geometry"), progress).build_part(part)


def _opened_job(
    sources: Sequence[Path | str],
    target: Path,
    options: LodOptions,
    progress: Progress,
    *,
    is_begun: bool = False,
) -> TreeJob:
    """Open the inputs and the folder of a building."""
    _check(options)
    inputs = [open_source(Path(path), options) for path in sources]
    read = [file for each in inputs for file in each.files]
    TreeFiles.of(target, read)
    if is_begun and not WorkFolder.is_begun(target, read, options):
        raise OutputError(str(target), "no building with these inputs and options", _BEGUN)
    return TreeJob.prepared(inputs, WorkFolder(target, read, options), options, progress)


_BEGUN, _SORTED = "one: --step begin", "all parts sorted before: --step sort"


def _check(options: LodOptions) -> None:
    """Raise an error for an option with an invalid value.

    Raises:
        UsageError: If there is one.
    """
    if not LEAST_LEAF <= options.leaf_splats <= NODE_SPLATS:
        expected = f"{LEAST_LEAF} to {NODE_SPLATS}"
        raise UsageError("leaf_splats", str(options.leaf_splats), expected)
    if options.sh_degree is not None and not 0 <= options.sh_degree <= MAX_DEGREE:
        raise UsageError("sh_degree", str(options.sh_degree), f"0 to {MAX_DEGREE}")
    if options.pixel is not None and not 0 <= options.pixel < np.inf:
        raise UsageError("pixel", f"{options.pixel:g}", "a size, or 0 for no low-pass")
    if options.meters_per_unit is not None:
        checked_unit(options.meters_per_unit)
    if options.memory_limit < LEAST_MEMORY:
        expected = f"{said_bytes(LEAST_MEMORY)} or more"
        raise UsageError("memory_limit", said_bytes(options.memory_limit), expected)
