"""What a command takes from its start to its end, in a first process and in later ones.

    python -m benchmarks.commands [--json FILE]

The first process finds no compiled kernel, the later ones what it has kept; medians of those. A
device that is not here is left out.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import DATA
from usdsplat.kernels.cuda.support import obstacle

LATER = 3
"""Processes after the first."""
CAPTURE = "splats/statue_angel.sog"
COMMANDS = {
    "a PNG of 1920×1080": ("-o", "{folder}/a.png"),
    "an EXR with Z and ids": ("-o", "{folder}/a.exr", "--aovs", "color,Z,id"),
}


def seconds(words: list[str], cache: Path) -> float:
    """What one process takes [s]."""
    program = "import sys; from usdsplat.cli.main import main; sys.exit(main(sys.argv[1:]))"
    before = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", program, *words],
        env={**os.environ, "USDSPLAT_CACHE_DIR": str(cache)},
        check=True,
        capture_output=True,
    )
    return time.perf_counter() - before


def main(report: Report) -> None:
    """Print the table."""
    devices = ["cpu", *(["cuda"] if obstacle() is None else [])]
    table = Table(title=f"{CAPTURE}: seconds of a process")
    for name in ("command", "device", "first", f"later, median of {LATER}"):
        table.add_column(name, justify="right")
    with tempfile.TemporaryDirectory() as folder:
        for what, flags in COMMANDS.items():
            for device in devices:
                cache = Path(folder) / f"{device}-{len(what)}"
                words = ["render", str(DATA / CAPTURE), "--resolution", "1920x1080"]
                words += ["--device", device, *(flag.format(folder=folder) for flag in flags)]
                first, *later = (seconds(words, cache) for _ in range(1 + LATER))
                middle = statistics.median(later)
                report.add(device=device, command=what, first=first, later=middle)
                table.add_row(what, device, f"{first:.1f}", f"{middle:.2f}")
    report.show(table)


if __name__ == "__main__":
    with Report("commands", sys.argv[1:]) as report:
        main(report)
