"""Read many files in one process with limited memory and time, and report the result of each."""

from __future__ import annotations

import faulthandler
import json
import resource
import subprocess
import sys
import time
import traceback
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest

from usdsplat import formats
from usdsplat.core.errors import UsdSplatError

MEMORY_LIMIT_MB = 500
"""Of a whole process, Python and NumPy included."""

_ADDRESSES = 16 << 30  # [byte] what must not be had, threads' stacks and arenas included
_HANG_S = 60  # generous: no test asserts a time, but none waits for ever

linux_only = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="the system does not tell the highest memory"
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What reading one file came to."""

    path: str
    splats: int
    """-1 if it was refused."""
    said: str
    """The sentence of a refusal."""
    bug: str
    """Traceback of anything else, or what is wrong with the cloud."""
    peak: int
    """[MB] the most memory that the process had meanwhile."""
    seconds: float


def read_in_a_process(paths: Iterable[Path], *, drop: bool = False) -> list[Outcome]:
    """Read every path in one fresh process, where warnings are errors.

    Args:
        paths: Captures.
        drop: Whether splats that are not finite are left out.
    """
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "tests.formats.reading", *["--drop"] * drop],
        input="\n".join(map(str, paths)),
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert done.returncode == 0 and done.stderr == "", done.stderr
    return [Outcome(**json.loads(line)) for line in done.stdout.splitlines()]


def check_sentence(outcome: Outcome) -> None:
    """Assert that a refusal is one short sentence that starts with the file, or one beside it."""
    assert outcome.bug == "", f"{outcome.path}\n{outcome.bug}"
    said, path = outcome.said, outcome.path
    assert (
        said.startswith(str(Path(path).parent)) and ": found " in said and ", expected " in said
    ), said
    assert "\n" not in said and len(said) < 400 + 2 * len(path), said


def _outcome(path: str, how: formats.ReadOptions) -> Outcome:
    Path("/proc/self/clear_refs").write_text("5")  # forgets the highest memory
    faulthandler.dump_traceback_later(_HANG_S, exit=True)
    started = time.perf_counter()
    splats, said, bug = -1, "", ""
    try:
        cloud = formats.read(path, how=how).cloud
        splats, bug = len(cloud), _flaw(cloud)
    except UsdSplatError as error:
        said = str(error)
    except BaseException:
        bug = traceback.format_exc()
    seconds = time.perf_counter() - started
    faulthandler.cancel_dump_traceback_later()
    # Not getrusage: its maximum counts the process that started this one.
    lines = Path("/proc/self/status").read_text().splitlines()
    peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) // 1024
    return Outcome(path, splats, said, bug, peak, seconds)


def _flaw(cloud) -> str:
    """What is wrong with a cloud that no reader may give."""
    for name in ("positions", "scales", "rotations", "opacities", "sh"):
        if not np.isfinite(getattr(cloud, name)).all():
            return f"{name} are not finite"
    lengths = np.linalg.norm(cloud.rotations.astype(np.float64), axis=1)
    if len(cloud) and np.abs(lengths - 1).max() > 1e-5:
        return "rotations are not of length 1"
    if cloud.scales.min(initial=0) < 0:
        return "scales are negative"
    if cloud.opacities.min(initial=0) < 0 or cloud.opacities.max(initial=1) > 1:
        return "opacities are beyond 0 to 1"
    return ""


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    asked = formats.ReadOptions(drop_nonfinite="--drop" in sys.argv)
    for line in sys.stdin.read().splitlines():
        print(json.dumps(asdict(_outcome(line, asked))), flush=True)
