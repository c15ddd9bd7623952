"""The hidden folder beside a tree in which it is built, and from which building continues.

`city.usda` is built in `.city.usda.building`. `job.json` in it states inputs and options. If they
are others, the folder is emptied. All files appear whole, so that those that exist are used.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from usdsplat import __version__
from usdsplat.core.errors import OutputError
from usdsplat.core.output import is_private, write_output
from usdsplat.formats.options import READ_OPTIONS
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.survey import Survey

VERSION = 3
"""Version of what the files in the folder mean."""

_JOB, _SURVEYS = "job.json", "surveys.json"
_RUNS, _CHUNKS = "runs", "chunks"


class WorkFolder:
    """Folder in which a tree is built.

    Args:
        target: The file of the tree.
        inputs: Inputs, in order.
        options: Options of the building.

    Raises:
        OutputError: If the folder cannot be made.
    """

    def __init__(self, target: Path, inputs: Sequence[Path], options: LodOptions) -> None:
        final = Path(os.path.realpath(target))
        self.path = _building(final)
        self.runs, self.chunks = self.path / _RUNS, self.path / _CHUNKS
        job = _job(inputs, options)
        self.is_continued = self.is_begun(target, inputs, options)
        """Whether an interrupted building is continued."""
        try:
            if not self.is_continued:
                self.remove()
            for folder in (self.path, self.runs, self.chunks):
                folder.mkdir(exist_ok=True)
        except OSError as error:
            found = (error.strerror or str(error)).lower()
            raise OutputError(str(target), found, "a folder where folders can be made") from error
        if not self.is_continued:
            _write(self.path / _JOB, job)

    @staticmethod
    def is_begun(target: Path, inputs: Sequence[Path], options: LodOptions) -> bool:
        """Return whether there is an unfinished building with these inputs and options."""
        final = Path(os.path.realpath(target))
        known = _read(_building(final) / _JOB)
        return bool(known == _job(inputs, options))

    @staticmethod
    def remove_of(target: Path) -> None:
        """Remove the folder of a building that cannot go on."""
        shutil.rmtree(_building(Path(os.path.realpath(target))), ignore_errors=True)

    def surveys(self) -> list[Survey] | None:
        """Return the stored surveys, or None."""
        found = _read(self.path / _SURVEYS)
        return None if found is None else [Survey.from_json(each) for each in found]

    def store(self, surveys: Iterable[Survey]) -> None:
        """Store the surveys of all inputs."""
        _write(self.path / _SURVEYS, [each.as_json() for each in surveys])

    def remove_other_runs(self, names: Iterable[str]) -> None:
        """Remove all runs but those whose files have these names without suffix."""
        known = set(names)
        for path in self.runs.iterdir():
            if path.stem not in known and path.is_file():
                path.unlink()

    def remove(self) -> None:
        """Remove the folder with all files."""
        shutil.rmtree(self.path, ignore_errors=True)

    def remove_if_empty(self) -> None:
        """Remove the folder if nothing was made in it that another attempt could use."""
        kept = [each for each in self.path.rglob("*") if each.is_file() and each.name != _JOB]
        if all(is_private(each.parent.name) for each in kept):
            self.remove()


def _building(final: Path) -> Path:
    return final.with_name(f".{final.name}.building")


def _job(inputs: Sequence[Path], options: LodOptions) -> Any:
    """Return what decides the tree, as values of JSON."""
    values = asdict(replace(options, reading=READ_OPTIONS))  # whose progress cannot be copied
    del values["memory_limit"]
    values["reading"] = {"lod": options.reading.lod}
    stamps = [stamp for path in inputs for stamp in _stamps(path)]
    made = {"version": VERSION, "by": __version__, "options": values, "inputs": stamps}
    return json.loads(json.dumps(made))


def _stamps(path: Path) -> list[list[Any]]:
    """Return name, size and time of a file, or of all files of a folder or of an unpacked SOG."""
    base = path.parent if path.name.lower() in ("meta.json", "lod-meta.json") else path
    files = [base] if base.is_file() else sorted(each for each in base.rglob("*") if each.is_file())
    found = []
    for each in files:
        with suppress(OSError):
            known = each.stat()
            found.append([os.path.abspath(each), known.st_size, known.st_mtime_ns])
    return found or [[os.path.abspath(path), 0, 0]]


def _read(path: Path) -> Any:
    """Return the content of a file of JSON; None if there is no such file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _write(path: Path, value: Any) -> None:
    """Write a file of JSON."""
    write_output(path, json.dumps(value, indent=1).encode())
