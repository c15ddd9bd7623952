"""Write the job of a command as an Open Job Description bundle."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.cli import console
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.folders import made_folder

if TYPE_CHECKING:
    from usdsplat.jobs.job import Job
    from usdsplat.jobs.openjd import Bundle, Source


def on_a_farm(reporting: ReportingOptions) -> ReportingOptions:
    """Return the options with which a task of a bundle reports."""
    return ReportingOptions(strict=reporting.strict, progress="openjd")


def stage_source(stage: Path) -> Source:
    """Return the parameter of a job with one input: its path in the bundle is the default."""
    from usdsplat.jobs.openjd import ASSETS, Source

    text = "stage or capture"
    return Source(name="Stage", path=f"{ASSETS}/{stage.name}", is_folder=False, text=text)


def folder_source() -> Source:
    """Return the parameter of a job with any number of inputs: the folder in which they are."""
    from usdsplat.jobs.openjd import ASSETS, Source

    return Source(name="Inputs", path=ASSETS, is_folder=True, text="folder of the inputs")


def output_name(output: str | Path | None) -> str:
    """Return the output of the commands of a bundle.

    Raises:
        UsageError: If there is none.
    """
    from usdsplat.jobs.openjd import output_word

    if output is None:
        raise UsageError("--openjd", "no --output", "-o FILE, whose name the results get")
    return output_word(Path(output).name)


def absolute(path: str | Path | None) -> str | None:
    """Return a path that holds in any folder; None for none."""
    return None if path is None else str(Path(path).absolute())


def existing(paths: Iterable[str | Path | None]) -> tuple[str, ...]:
    """Return the absolute paths of those files that exist, each once."""
    files = (str(Path(path).absolute()) for path in paths if path and Path(path).exists())
    return tuple(dict.fromkeys(files))


def write(
    job: Job, bundle: Bundle, sources: Sequence[Path], reporter: Reporter, *, json: bool
) -> int:
    """Copy the inputs, write the bundle, print the path of its template, and return the status.

    Args:
        job: The job.
        bundle: What the bundle says beside.
        sources: The stage or capture; those of a folder are copied to the folders 1, 2, ... in it.
        reporter: Has the findings on the inputs, and prints the JSON object.
        json: Whether there is one, rather than the path.

    Raises:
        StrictError: With --strict, if there is a finding.
        UsageError: If the job cannot be in a template.
        OutputError: If the folder is not empty, or a file cannot be written.
        StageError: If an input cannot be copied.
    """
    from usdsplat.jobs.openjd import ASSETS, template_of, write_bundle
    from usdsplat.products.localizing import localize

    reporter.findings.check()
    template_of(job, bundle)
    _check_empty(bundle.folder)
    assets = bundle.folder / ASSETS
    with made_folder(bundle.folder), _emptied_on_errors(bundle.folder):
        for number, source in enumerate(sources, 1):
            folder = assets / str(number) if bundle.source.is_folder else assets
            localize(source, folder, bundle.frames or None)
        template = write_bundle(job, bundle)[0]
    if json:
        reporter.print_json({"template": str(template)})
    else:
        console.say_path(template)
    return 0


@contextmanager
def _emptied_on_errors(folder: Path) -> Iterator[None]:
    """Remove what was written into an empty folder, if there is an error in the context."""
    try:
        yield
    except BaseException:
        for each in folder.iterdir():
            if each.is_dir():
                shutil.rmtree(each, ignore_errors=True)
            else:
                each.unlink(missing_ok=True)
        raise


def _check_empty(folder: Path) -> None:
    """Raise an error unless a folder can be made here, or is an empty one.

    Raises:
        OutputError: If there is something else.
    """
    expected = "a new folder, or an empty one"
    try:
        there = sorted(path.name for path in folder.iterdir())
    except FileNotFoundError:
        return
    except NotADirectoryError:
        raise OutputError(str(folder), "a file", expected) from None
    except OSError as error:
        raise OutputError(str(folder), (error.strerror or str(error)).lower(), expected) from error
    if there:
        more = f" and {len(there) - 3} more" if len(there) > 3 else ""
        raise OutputError(str(folder), f"{', '.join(there[:3])}{more} in it", expected)
