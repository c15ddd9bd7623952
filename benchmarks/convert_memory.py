"""Measure the peak memory of conversions from .ply to .usdc, each in a separate process.

    python -m benchmarks.convert_memory [SPLATS [FRAMES]]

The source is generated, degree 3. For comparison, the table has the memory of a process that
converts a single splat, and USD's float arrays: 236 bytes per splat. A sequence of FRAMES captures
of a tenth of SPLATS each must not take more than one of them; its arrays are those of one frame.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.table import Table

from benchmarks.author import capture
from benchmarks.report import Report
from usdsplat import formats

BYTES = 236
"""Bytes of a splat of degree 3 in USD's float arrays."""
MIB = 1 << 20
_BLOCK = 100_000

_CONVERT = """
import sys
from pathlib import Path
from usdsplat.interchange import import_capture, import_sequence
{}
lines = Path("/proc/self/status").read_text().splitlines()
print(*(line.split()[1] for line in lines if line.startswith("VmHWM")))
"""  # not getrusage: its peak begins with the parent's
_CASES = {
    "float": "import_capture(sys.argv[1], sys.argv[2])",
    "float, axes baked": "import_capture(sys.argv[1], sys.argv[2], bake_axes=True)",
    "half": "import_capture(sys.argv[1], sys.argv[2], form='half')",
    "packed": "import_capture(sys.argv[1], sys.argv[2], form='packed')",
}
_SEQUENCES = {
    "time samples": "import_sequence(sys.argv[1], sys.argv[2])",
    "value clips": "import_sequence(sys.argv[1], sys.argv[2], clips=True)",
}


def write_ply(path: Path, count: int) -> None:
    """Write a .ply of random splats, block by block."""
    block = capture(min(count, _BLOCK))
    formats.write(block, path)
    header, _, rows = path.read_bytes().partition(b"end_header\n")
    header = header.replace(f"vertex {len(block)}".encode(), f"vertex {count}".encode())
    width = len(rows) // len(block)
    with path.open("wb") as file:
        file.write(header + b"end_header\n")
        for left in range(count, 0, -len(block)):
            file.write(rows[: left * width])


def run(action: str, source: Path, target: Path) -> tuple[float, float]:
    """Return seconds and peak resident memory [MiB] of a process that runs an action."""
    command = [sys.executable, "-c", _CONVERT.format(action), str(source), str(target)]
    began = time.perf_counter()
    said = subprocess.check_output(command)
    return time.perf_counter() - began, int(said) / 1024


def main(report: Report, count: int = 10_000_000, frames: int = 5) -> None:
    """Print the table."""
    table = Table(title=f"{count} splats, degree 3 [MiB]")
    for title in ("case", "seconds", "base", "arrays", "peak", "peak/arrays"):
        table.add_column(title, justify="right")
    with tempfile.TemporaryDirectory(prefix="usdsplat-") as folder:
        one, many = Path(folder, "one.ply"), Path(folder, "many.ply")
        write_ply(one, 1)
        write_ply(many, count)
        for name, action in _CASES.items():
            _, base = run(action, one, Path(folder, "one.usdc"))
            _row(table, name, base, count, run(action, many, Path(folder, "many.usdc")))
        many.unlink()
        for frame in range(frames):
            write_ply(Path(folder, f"cap.{frame:04d}.ply"), count // 10)
        for name, action in _SEQUENCES.items():
            title = f"{frames} x {count // 10}, {name}"
            result = run(action, Path(folder, "cap.####.ply"), Path(folder, "sequence.usdc"))
            _row(table, title, base, count // 10, result)
    report.show(table)


def _row(table: Table, name: str, base: float, count: int, result: tuple[float, float]) -> None:
    arrays, (seconds, peak) = count * BYTES / MIB, result
    cells = (f"{seconds:.1f}", f"{base:.0f}", f"{arrays:.0f}", f"{peak:.0f}")
    table.add_row(name, *cells, f"{peak / arrays:.2f}")


if __name__ == "__main__":
    with Report("convert_memory", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
