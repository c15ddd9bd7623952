"""Measure the time of commands from start to end, in a first process and in later ones.

    python -m benchmarks.commands [--json FILE]

The first process finds no compiled kernels; the later ones use those that it stored. Their times
are medians. A device that is not available is left out.
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
"""Number of processes after the first."""
CAPTURE = DATA / "splats/statue_angel.sog"
PICTURE = ("render", str(CAPTURE), "--resolution", "1920x1080", "--device", "{device}")
COMMANDS: dict[str, tuple[str, ...]] = {
    "render a PNG": (*PICTURE, "-o", "{folder}/a.png"),
    "render an EXR with Z and ids": (*PICTURE, "-o", "{folder}/a.exr", "--aovs", "color,Z,id"),
    "demo": ("demo", "-o", "{folder}/demo"),
    "compile": ("compile", "--device", "{device}"),
}


def seconds(words: list[str], cache: Path) -> float:
    """Return the time of one process [s]."""
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
    devices = ["cpu", *(["cuda", "auto"] if obstacle() is None else [])]
    table = Table(title=f"{CAPTURE.name}, 1920×1080: seconds of a process")
    for name in ("command", "device", "first", f"later, median of {LATER}"):
        table.add_column(name, justify="right")
    with tempfile.TemporaryDirectory() as folder:
        for what, words in COMMANDS.items():
            for device in devices if any("{device}" in word for word in words) else ["auto"]:
                cache = Path(folder) / f"{device} {what}"
                filled = [word.format(folder=folder, device=device) for word in words]
                first, *later = (seconds(filled, cache) for _ in range(1 + LATER))
                middle = statistics.median(later)
                report.add(device=device, command=what, first=first, later=middle)
                table.add_row(what, device, f"{first:.1f}", f"{middle:.2f}")
    report.show(table)


if __name__ == "__main__":
    with Report("commands", sys.argv[1:]) as report:
        main(report)
