"""Check mutated stages as `validate` and `render` do, and print a table of how they end.

    python -m tests.products.stage_fuzz [--first N] [--count N]

Seeds run in several processes after each other, so that a crash of one is attributed to a seed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

from pxr import UsdUtils

from tests.products.stage_mutations import mutated, sources
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.findings import Findings
from usdsplat.delegate.engine import PURPOSES, Engine
from usdsplat.interchange.files import open_stage
from usdsplat.products.checking import check_stage
from usdsplat.render.settings import RenderSettings

COUNT = 2000
CHUNK = 250
"""Seeds of one process."""
LONGEST = 300
"""Largest time of a process [s]."""


def ended(path: Path) -> str:
    """Validate a stage, and draw it; return how that ended.

    Raises:
        Exception: Anything but the errors of usdsplat, which is a defect.
    """
    messages = UsdUtils.CoalescingDiagnosticDelegate()
    findings = Findings()
    try:
        stage = open_stage(path)
        check_stage(stage, findings)
        with Engine(stage, device="cpu", purposes=PURPOSES) as engine:
            view = engine.view(resolution=(16, 12))
            engine.picture(view, RenderSettings(), ("color", "depth"))
    except UsdSplatError as error:
        return type(error).__name__
    finally:
        messages.TakeUncoalescedDiagnostics()
        del messages
    return "drawn with findings" if len(findings) else "drawn"


def checked(seed: int, originals: list[Path]) -> str:
    """Return how a mutated stage ends, and check that nothing is left beside it."""
    with tempfile.TemporaryDirectory() as name:
        path = mutated(seed, originals, Path(name))
        before = sorted(each.name for each in Path(name).iterdir())
        result = ended(path)
        assert sorted(each.name for each in Path(name).iterdir()) == before
    return result


def several(first: int, count: int) -> int:
    """Check seeds, and print a line for each; return the number of defects."""
    defects = 0
    with tempfile.TemporaryDirectory() as name:
        originals = sources(Path(name))
        for seed in range(first, first + count):
            print(f"begin {seed}", flush=True)
            try:
                print(f"end {checked(seed, originals)}", flush=True)
            except Exception:
                defects += 1
                print(f"end DEFECT\n{traceback.format_exc()}", flush=True)
    return defects


def main() -> int:
    """Run all seeds, and print a table of how they ended."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--here", action="store_true", help="in this process")
    options = parser.parse_args()
    if options.here:
        return min(1, several(options.first, options.count))
    ends: Counter[str] = Counter()
    stop = options.first + options.count
    first = options.first
    while first < stop:
        words = ["--here", "--first", str(first), "--count", str(min(CHUNK, stop - first))]
        command = [sys.executable, "-m", "tests.products.stage_fuzz", *words]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
            text, how = done.stdout, f"status {done.returncode}\n{done.stderr[-2000:]}"
        except subprocess.TimeoutExpired as error:
            text, how = (error.stdout or b"").decode(), "does not end"
        begun = [int(line.split()[1]) for line in text.splitlines() if line.startswith("begin ")]
        results = [line[4:] for line in text.splitlines() if line.startswith("end ")]
        ends.update(results)
        if "DEFECT" in results:
            print("\n".join(each for each in text.split("begin ") if "DEFECT" in each))
        if len(results) < len(begun) or not begun:
            ends["CRASH"] += 1
            print(f"seed {begun[-1] if begun else first}: {how}")
        first = begun[-1] + 1 if begun else first + CHUNK
    print("\n".join(f"{number:6}  {name}" for name, number in sorted(ends.items())))
    return min(1, ends["DEFECT"] + ends["CRASH"])


if __name__ == "__main__":
    raise SystemExit(main())
