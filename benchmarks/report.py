"""What a benchmark prints and, with `--json FILE`, writes.

    with Report("frame", sys.argv[1:]) as report:
        report.add(device="cpu", scene="garden", splats=111_785, ms=63.2, low=61.0, high=70.1)
        report.show(table)

The first line that is printed is the machine with its versions. The file holds an object: the
benchmark's name, the machine, every table that was shown as text, every sentence that was said, and
the rows that were added, which `benchmarks.plot` reads. A row has, of those that make sense:

    device   what did the work, such as "cpu", "cuda" or a peer with its version
    scene    what was drawn or simulated
    splats   how many the scene has;  visible: how many of them are in the picture
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
    """Median and extremes of times [ms], under a row's names."""
    return {"ms": float(np.median(times)), "low": float(min(times)), "high": float(max(times))}


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """What a file of results holds."""

    benchmark: str
    machine: Machine
    tables: list[Row]
    notes: list[str]
    rows: list[Row]


def read_results(path: Path) -> Results:
    """Results that a `Report` wrote."""
    values = json.loads(path.read_text(encoding="utf-8"))
    return Results(
        benchmark=values["benchmark"],
        machine=Machine(**values["machine"]),
        tables=values["tables"],
        notes=values["notes"],
        rows=values["rows"],
    )


class Report:
    """A benchmark's output; at the end of a `with` block, the file is written.

    Args:
        benchmark: The script's name.
        arguments: Those of the command line; `--json FILE` is taken out.

    Attributes:
        arguments: The rest.
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
        """Keep a row of numbers for the file."""
        self._rows.append(row)

    def show(self, table: Table, width: int = 120) -> None:
        """Print a table and keep its text for the file."""
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
        """Print a sentence and keep it for the file."""
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
    """Text without markup."""
    return "" if content is None else Text.from_markup(str(content)).plain
