"""Run `usdsplat lod` as a job."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.cli import bundles
from usdsplat.cli.job_options import JobOptions, JobRunner, environments, of_task
from usdsplat.cli.lod_options import Options
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.values import bytes_of
from usdsplat.cli.words import words_of
from usdsplat.core.folders import check_folder

if TYPE_CHECKING:
    from usdsplat.interchange.lod import LodOptions

PARTS = 4
"""Parts of each step, for each process."""
FARM_PARTS = 8
"""Parts of each step in a bundle, whose workers are not known."""


def run_parts(options: Options, made: LodOptions, target: Path, reporter: Reporter) -> None:
    """Report the findings of the inputs, and do all steps but the last one as a job.

    Args:
        options: The options of the command.
        made: Those of the building.
        target: The output of the command.
        reporter: Receives progress and findings.

    Raises:
        StrictError: With --strict, if there is a finding.
        UsdSplatError: If an input cannot be opened.
        OutputError: If nothing can be written beside the output.
        JobError: If a task fails.
    """
    from usdsplat.interchange.lod import inspect
    from usdsplat.interchange.lod.options import MEMORY
    from usdsplat.jobs.trees import tree_job

    check_folder(target.parent)
    task = replace(options, json=True, job=JobOptions(), reporting=of_task(options.reporting))
    memory = bytes_of(options.memory_limit)
    workers = environments(options.job, device="cpu", threads=None, memory=memory or MEMORY)
    with JobRunner(options.job, reporter, workers, ("usdsplat.interchange.lod",)) as runner:
        reporter.findings.extend(inspect(options.sources, options=made))
        reporter.findings.check()
        parts = PARTS * len(runner)
        for _ in runner.run(tree_job(("lod", *words_of(task)), parts=parts, memory=memory)):
            pass


def write_bundle(options: Options, folder: Path, reporter: Reporter) -> int:
    """Write a bundle for a farm whose steps build the tree, and return the exit status.

    Args:
        options: The options of the command.
        folder: Folder of the bundle.
        reporter: See `bundles.write`.

    Raises:
        UsdSplatError: See `bundles.write`.
    """
    from usdsplat.jobs.openjd import Bundle
    from usdsplat.jobs.trees import tree_job

    parameter = bundles.folder_source()
    task = replace(
        options,
        sources=tuple(
            Path(parameter.word(f"{number}/{source.name}"))
            for number, source in enumerate(options.sources, 1)
        ),
        output=Path(bundles.output_name(options.output)),
        json=False,
        job=JobOptions(),
        reporting=bundles.on_a_farm(options.reporting),
    )
    job = tree_job(
        ("lod", *words_of(task)),
        parts=FARM_PARTS,
        memory=bytes_of(options.memory_limit),
        finishes=True,
    )
    bundle = Bundle(folder=folder, source=parameter, results="tree")
    return bundles.write(job, bundle, options.sources, reporter, json=options.json)
