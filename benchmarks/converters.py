"""Measure how fast files are read and written, with gsply and usd-convert-gsplat in the same run.

    python -m benchmarks.peers        installs them, once
    python -m benchmarks.converters [SPLATS]

The table has one capture of degree 3 in every format that gsply supports. Both sides take turns,
with warm caches, and have the same file and the same arrays. gsply returns logarithms, logits and
views of the file's rows. "physical" means converted to what our reader returns: scales, opacities,
and all harmonics in one array. The floor is a plain copy of the file's bytes.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.author import capture
from benchmarks.peers import gsply, missing, python_of
from benchmarks.peers.server import Server
from benchmarks.report import Report
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange import import_capture

REPEATS = 3
FILES = {
    ".ply": "capture.ply",
    "compressed .ply": "capture.compressed.ply",
    ".spz v3": "capture3.spz",
    ".spz v4": "capture4.spz",
    ".sog": "capture.sog",
}
"""Format -> file."""
PEER_SHARE = 10
"""Divisor of the number of splats for usd-convert-gsplat, which needs a minute for a million."""

Spent = tuple[float, float]
"""Wall and CPU seconds."""


def timed(work: Callable[[], object]) -> Spent:
    """Return the seconds of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def median(spent: list[Spent]) -> Spent:
    """Return the medians of several calls, separately for wall and CPU time."""
    wall, cpu = np.median(spent, axis=0)
    return float(wall), float(cpu)


def write(cloud: SplatCloud, path: Path) -> None:
    """Write a capture with our writer."""
    version = 3 if path.name.endswith("3.spz") else 4
    formats.write(cloud, path, how=formats.WriteOptions(spz_version=version))


def row(
    table: Table, name: str, ours: Spent, theirs: Spent | None, floor: float, size: int
) -> None:
    """Add one line to the table."""
    beside = ["–", "–", "–"]
    if theirs:
        beside = [f"{theirs[0]:.3f}", f"{theirs[1]:.3f}", f"{theirs[0] / ours[0]:.1f}"]
    own = [f"{ours[0]:.3f}", f"{ours[1]:.3f}"]
    table.add_row(name, *own, *beside, f"{floor:.3f}", f"{size / 1e6:.0f}")


def in_turns(ours: Callable[[], object], theirs: Callable[[], Spent] | None) -> list[Spent | None]:
    """Return the medians of both sides, which take turns. The first turn of each is not counted."""
    spent: tuple[list[Spent], list[Spent]] = ([], [])
    for _ in range(REPEATS + 1):
        spent[0].append(timed(ours))
        if theirs:
            spent[1].append(theirs())
    return [median(side[1:]) if side else None for side in spent]


def asked(peer: Server, **request: object) -> Spent:
    """Return the seconds that gsply reports for a request."""
    answer = peer.ask(**request)
    return answer["wall"], answer["cpu"]


def files(table: Table, cloud: SplatCloud, folder: Path, peer: Server | None) -> None:
    """Measure reading and writing of every format."""
    write(cloud, folder / FILES[".ply"])
    if peer:
        peer.ask(do="read", path=str(folder / FILES[".ply"]))
    for name, file in FILES.items():
        path, other = folder / file, folder / f"theirs-{file}"
        request = {"do": "write", "path": str(other), "version": 3 if "v3" in name else 4}
        can_write = peer is not None and name != ".sog"
        theirs = (lambda r=request: asked(peer, **r)) if can_write else None
        ours, beside = in_turns(lambda path=path: write(cloud, path), theirs)
        floor, _ = timed(lambda path=path: (folder / "floor").write_bytes(path.read_bytes()))
        row(table, f"write {name}", ours, beside, floor, path.stat().st_size)
    for name, file in FILES.items():
        path = folder / file
        theirs = (lambda p=path: asked(peer, do="read", path=str(p))) if peer else None
        ours, beside = in_turns(lambda path=path: formats.read(path), theirs)
        floor, _ = timed(path.read_bytes)
        row(table, f"read {name}", ours, beside, floor, path.stat().st_size)
        if peer:
            request = {"do": "read", "path": str(path), "physical": True}
            ours, beside = in_turns(
                lambda path=path: formats.read(path), lambda r=request: asked(peer, **r)
            )
            row(table, f"read {name}, physical", ours, beside, floor, path.stat().st_size)


def to_usd(table: Table, cloud: SplatCloud, folder: Path) -> None:
    """Measure a .ply to a saved stage, and usd-convert-gsplat on a part of it, scaled."""
    source, target = folder / FILES[".ply"], folder / "ours.usdc"
    ours, _ = in_turns(lambda: import_capture(source, target), None)
    python, theirs = python_of("usd_convert"), None
    if python:
        part = folder / "part.ply"
        formats.write(edit.take(cloud, np.arange(len(cloud) // PEER_SHARE)), part)
        tool = python.with_name("usd-convert-gsplat")
        command = [str(tool), "-i", str(part), "-o", str(folder / "theirs.usdc")]
        wall, _ = timed(lambda: subprocess.run(command, check=True, capture_output=True))
        theirs = (PEER_SHARE * wall, float("nan"))
    floor, _ = timed(lambda: (folder / "floor").write_bytes(source.read_bytes()))
    row(table, ".ply to .usdc", ours, theirs, floor, target.stat().st_size)


def main(report: Report, count: int = 1_000_000) -> None:
    """Print the table."""
    for sentence in missing():
        report.say(sentence)
    peer = gsply()
    table = Table(title=f"{count:,} splats of degree 3, seconds: median of {REPEATS}, in turns")
    names = ("what", "wall", "CPU", "peer wall", "peer CPU", "times faster", "floor", "MB")
    for name in names:
        table.add_column(name, justify="left" if name == "what" else "right")
    cloud = capture(count)
    with tempfile.TemporaryDirectory() as name:
        files(table, cloud, Path(name), peer)
        to_usd(table, cloud, Path(name))
    if peer:
        peer.close()
    report.show(table)
    report.say("Peers: gsply for files, usd-convert-gsplat for .usdc (a tenth, times ten).")


if __name__ == "__main__":
    with Report("converters", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
