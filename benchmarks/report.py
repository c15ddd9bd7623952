"""Print the results of a benchmark and, with `--json FILE`, write them.

    with Report("frame", sys.argv[1:]) as report:
        report.add(device="cpu", scene="garden", splats=111_785, ms=63.2, low=61.0, high=70.1)
        report.show(table)

The first printed line is the machine with its versions. The file contains one object: the
benchmark's name, the machine, all tables as text, all printed sentences, and the added rows, which
`benchmarks.plot` reads. A row has those of these entries that apply:

    device   what was measured, such as "cpu", "cuda" or a peer with its version
    scene    what was drawn or simulated
    splats   splats of the scene;  visible: splats in the picture
    size     "WIDTHxHEIGHT" [pixel]
    ms       median wall or GPU time;  low, high: the extremes;  cpu_ms: processor time
    db       the picture's peak signal-to-noise ratio against float64
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from benchmarks.machine import Machine, this_machine

Row = dict[str, Any]


def spread(times: Sequence[float]) -> Row:
    """Return median and extremes of times [ms], with the names of a row's entries."""
    return {"ms": float(np.median(times)), "low": float(min(times)), "high": float(max(times))}


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """Content of a file of results."""

    benchmark: str
    machine: Machine
    tables: list[Row]
    notes: list[str]
    rows: list[Row]


def read_results(path: Path) -> Results:
    """Read results that a `Report` wrote."""
    values = json.loads(path.read_text(encoding="utf-8"))
    return Results(
        benchmark=values["benchmark"],
        machine=Machine(**values["machine"]),
        tables=values["tables"],
        notes=values["notes"],
        rows=values["rows"],
    )


class Report:
    """Output of a benchmark, a context manager. The file is written at its end.

    Args:
        benchmark: The script's name.
        arguments: Arguments of the command line; `--json FILE` is removed.

    Attributes:
        arguments: The remaining arguments.
    """

    def __init__(self, benchmark: str, arguments: Sequence[str] = ()) -> None:
        self._benchmark = benchmark
        self._machine = this_machine()
        self._tables: list[Row] = []
        self._notes: list[str] = []
        self._rows: list[Row] = []
        self._path: Path | None = None
        self.arguments = list(arguments)
        if "--json" in self.arguments:
            at = self.arguments.index("--json")
            if at + 1 == len(self.arguments):
                sys.exit("--json: found no path, expected the file to write")
            self._path = Path(self.arguments[at + 1])
            del self.arguments[at : at + 2]
        print(self._machine.line, flush=True)

    def add(self, **row: Any) -> None:
        """Add a row of numbers for the file."""
        self._rows.append(row)

    def show(self, table: Table, width: int = 120) -> None:
        """Print a table and store its text for the file."""
        Console(width=width).print(table)
        cells = [[_plain(cell) for cell in column.cells] for column in table.columns]
        self._tables.append(
            {
                "title": _plain(table.title),
                "columns": [_plain(column.header) for column in table.columns],
                "rows": [list(row) for row in zip(*cells, strict=True)],
            }
        )

    def say(self, sentence: str) -> None:
        """Print a sentence and store it for the file."""
        print(sentence, flush=True)
        self._notes.append(sentence)

    def __enter__(self) -> Report:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None and self._path is not None:
            values = {
                "benchmark": self._benchmark,
                "machine": self._machine.as_json(),
                "tables": self._tables,
                "notes": self._notes,
                "rows": self._rows,
            }
            self._path.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def _plain(content: object) -> str:
    """Return the text without markup."""
    return "" if content is None else Text.from_markup(str(content)).plain
