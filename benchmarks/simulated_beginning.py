"""Measure how a simulation begins, by phase, and what is printed meanwhile.

    python -m benchmarks.simulated_beginning [SPLATS] [CASES]

Phases are those of the progress; kernels are compiled before. CPU seconds count all threads, and do
not depend on what else the machine does. `silence` is the longest time without a line of progress,
`ETA` the part of the lines that say how much is left. Every case runs twice: the first run learns
the rates of the machine. Each has a separate process.
"""

from __future__ import annotations

import io
import itertools
import json
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import garden
from usdsplat.core import edit
from usdsplat.kernels.compiling import compile_time

CASES = ("grow", "automatic", "push", "conform", "dissolve")
"""Presets; `automatic` is `grow` without the distances that it authors, so that carriers are as
close as splats."""
PATIENCE = 1.0
"""Duration from which a phase is a row [s]."""


class Lines(io.StringIO):
    """Standard error that keeps the time of each line."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[tuple[float, str]] = []

    def write(self, text: str) -> int:
        """Keep a line."""
        if text.strip():
            self.lines.append((time.perf_counter(), text.strip()))
        return len(text)


def measure(count: int, preset: str, rates: str) -> dict[str, Any]:
    """Begin one simulation of the first frame."""
    import numpy as np

    from usdsplat import formats
    from usdsplat.cli.progress import listening
    from usdsplat.core.progress import silent
    from usdsplat.interchange.files import open_stage
    from usdsplat.products.presets import make_stage
    from usdsplat.sim.stage.overrides import override
    from usdsplat.sim.stage.simulating import simulate

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        cloud = garden(3, degree=0)[0]
        rng = np.random.default_rng(0)
        formats.write(
            edit.take(cloud, rng.random(len(cloud)) < count / len(cloud)), folder / "a.ply"
        )
        options = {"material": "rubber"} if preset == "push" else {}
        name = "grow" if preset == "automatic" else preset
        make_stage(
            name, folder / "a.ply", folder / "shot.usda", axes=None, progress=silent,
            options=options,
        )  # fmt: skip
        stage = open_stage(folder / "shot.usda")
        if preset == "automatic":
            for knob in ("rd:patternScale", "carriers:spacing"):
                override(stage, f"{knob}=-1")
        said = Lines()
        began, cpu = time.perf_counter(), time.process_time()
        with redirect_stderr(said), compile_time() as compiled, listening(compiled) as progress:
            report = simulate(
                stage, folder / "bake.usda", [1.0], progress=progress,
                rates=Path(rates),
            )  # fmt: skip
            ended, spent = time.perf_counter(), compiled()
        at = [began, *(when for when, _ in said.lines), ended]
        return {
            "splats": next(iter(report.splats.values())),
            "wall": ended - began - spent,
            "cpu": time.process_time() - cpu,
            "compiling": spent,
            "phases": report.phases,
            "silence": max(b - a for a, b in itertools.pairwise(at)),
            "lines": [text for _, text in said.lines],
        }


def child(*arguments: object) -> dict[str, Any]:
    """Measure in a separate process."""
    command = [sys.executable, "-m", "benchmarks.simulated_beginning", "--one"]
    command += map(str, arguments)
    text = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    found: dict[str, Any] = json.loads(text.splitlines()[-1])
    return found


def main(report: Report, count: int = 1_000_000, cases: tuple[str, ...] = CASES) -> None:
    """Print the table."""
    table = Table(title=f"beginnings of {count:,} splats, one frame")
    for name in ("case", "wall s", "CPU s", "silence s", "lines with an ETA", "phases"):
        table.add_column(name, justify="right" if name.endswith("s") else "left")
    notes = []
    with tempfile.TemporaryDirectory() as folder:
        rates = Path(folder) / "rates.json"
        for case in cases:
            child(20_000, case, rates)  # compiles
            child(count, case, rates)
            found = child(count, case, rates)
            long = sorted(found["phases"].items(), key=lambda item: -item[1])
            lines = found["lines"]
            timed = sum("left" in line or "expected" in line for line in lines)
            table.add_row(
                case, f"{found['wall']:.1f}", f"{found['cpu']:.1f}", f"{found['silence']:.1f}",
                f"{timed} of {len(lines)}",
                ", ".join(f"{name} {s:.1f}" for name, s in long if s >= PATIENCE),
            )  # fmt: skip
            notes += [f"{case}: {line}" for line in lines]
    report.show(table)
    for note in notes:
        report.say(note)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(int(sys.argv[2]), sys.argv[3], sys.argv[4])))
    else:
        with Report("simulated_beginning", sys.argv[1:]) as report:
            size, *some = (*report.arguments, "1000000")[: max(1, len(report.arguments))]
            main(report, int(size), tuple(some) or CASES)
