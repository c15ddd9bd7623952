"""Fly over a splat tree in a session, as in the window, and measure how smooth and complete it is.

    python -m benchmarks.lod_flight TREE [--seconds 12]

The camera frames the whole tree, flies down to its middle, and rests there. A new state is asked
for every 1/60 s, of which the latest is drawn. "missing" is the number of parts of nodes in a
picture that coarser nodes stand for until they are read; nothing is ever left empty. "rest" is the
time from the last state to a picture in which all nodes are there.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.preview import PATIENCE, SIZE, TICK, Heard, framed
from benchmarks.report import Report
from usdsplat.preview.opening import open_document
from usdsplat.preview.session import Session
from usdsplat.preview.values import Picture, ViewState

NEAR = 0.04
"""Distance at the end of the flight, relative to that at its beginning."""
TURN = 0.5
"""Turn during the flight, as `FreeCamera.orbited` takes it."""
LEGS = 4
"""Number of parts of the flight that the table tells apart."""


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", type=Path)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--device", default="auto")
    options = parser.parse_args(report.arguments)
    heard = Heard()
    began = time.perf_counter()
    session = Session(
        lambda publish: open_document(options.tree, device=options.device, publish=publish)
    )
    session.listen(heard)
    session.look(ViewState(size=SIZE))
    heard.wait(lambda: bool(heard.pictures))
    first = heard.pictures[0]
    heard.wait_for_final(first[1].state)
    print(
        f"{options.tree.name}: first picture after {first[0] - began:.2f} s, "
        f"complete after {heard.pictures[-1][0] - began:.2f} s"
    )
    far = framed(session)
    near = far.dollied(NEAR)
    state = ViewState(size=SIZE, camera=far, is_moving=True)
    heard.pictures.clear()
    began, tick = time.perf_counter(), 0
    while (part := (time.perf_counter() - began) / options.seconds) < 1:
        state = replace(state, camera=far.towards(near, part).orbited(TURN * part, 0.0))
        session.look(state)
        tick += 1
        time.sleep(max(0.0, began + tick * TICK - time.perf_counter()))
    moved = list(heard.pictures)
    rest = replace(state, is_moving=False)
    stopped = time.perf_counter()
    session.look(rest)
    heard.wait(lambda: _is_complete(heard.pictures[-1][1], rest))
    table = Table(title=f"{options.tree.name}: {SIZE[0]}×{SIZE[1]}, {moved[-1][1].total:,} splats")
    for name in ("seconds", "fps", "longest ms", "scale", "splats", "missing", "MB"):
        table.add_column(name, justify="right")
    edges = began + np.linspace(0, options.seconds, LEGS + 1)
    for start, end in itertools.pairwise(edges):
        leg = [(at, each) for at, each in moved if start <= at < end]
        times = np.diff([at for at, _ in leg])
        scales = Counter(each.scale for _, each in leg)
        table.add_row(
            f"{start - began:.0f}–{end - began:.0f}",
            f"{1 / times.mean():.1f}",
            f"{1e3 * times.max():.0f}",
            " ".join(f"{scale:g}:{n / len(leg):.0%}" for scale, n in sorted(scales.items())),
            f"{np.median([each.splats for _, each in leg]):,.0f}",
            f"{np.median([each.missing for _, each in leg]):.0f}",
            f"{leg[-1][1].megabytes:,.0f}",
        )
    report.show(table, 120)
    print(f"rest: complete after {heard.pictures[-1][0] - stopped:.2f} s (limit {PATIENCE:g})")
    session.close()
    for sentence in heard.problems:
        print(f"  {sentence}")


def _is_complete(picture: Picture, state: ViewState) -> bool:
    """Return whether this is the best picture of a state, with all nodes."""
    return picture.state is state and picture.is_final and not picture.missing


if __name__ == "__main__":
    with Report("lod_flight", sys.argv[1:]) as report:
        main(report)
