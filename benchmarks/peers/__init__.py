"""Other converters, each in an environment of its own, to check and to time ours against.

    python -m benchmarks.peers

puts them into a folder `installed` beside this file that git ignores, or into the one that
`USDSPLAT_PEERS` names: gsply and usd-convert-gsplat from PyPI; node 22 and splat-transform from
npm, where npm is there. What is missing is said, and left out of the tables.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(os.environ.get("USDSPLAT_PEERS") or Path(__file__).parent / "installed")

PYTHON_PEERS = {
    "gsply": ("gsply[spz]==0.4.6", "imagecodecs"),
    "usd_convert": ("usd-convert-gsplat==0.1.15", "usd-core", "plyfile"),
}
"""Environment -> what is installed there."""
NODE_PEERS = ("node@22", "@playcanvas/splat-transform@3.7.0")

_SERVER = Path(__file__).parent / "gsply_server.py"


def python_of(peer: str) -> Path | None:
    """The interpreter of a peer's environment, if it is installed."""
    path = FOLDER / peer / "bin" / "python"
    return path if path.exists() else None


@dataclass(frozen=True, slots=True)
class SplatTransform:
    """PlayCanvas's converter, run by node."""

    node: Path
    script: Path

    def convert(self, source: Path, target: Path, *options: str) -> None:
        """Convert a file; `-g cpu` because there may be no GPU.

        Raises:
            RuntimeError: With what it printed, if it fails.
        """
        command = [str(self.node), str(self.script), "-w", "-g", "cpu", str(source), *options]
        done = subprocess.run([*command, str(target)], capture_output=True, text=True, check=False)
        if done.returncode or not target.exists():
            raise RuntimeError(f"splat-transform: {(done.stderr or done.stdout).strip()[-300:]}")


def splat_transform() -> SplatTransform | None:
    """splat-transform, if it is installed."""
    modules = FOLDER / "node" / "node_modules"
    found = SplatTransform(
        modules / "node" / "bin" / "node",
        modules / "@playcanvas" / "splat-transform" / "bin" / "cli.mjs",
    )
    return found if found.node.exists() and found.script.exists() else None


class Gsply:
    """gsply in a process that stays, so that its compiled code is warm when it is timed."""

    def __init__(self, python: Path) -> None:
        self._process = subprocess.Popen(
            [str(python), str(_SERVER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, **request: Any) -> dict[str, Any]:
        """Do one thing there; see `gsply_server`.

        Raises:
            RuntimeError: With its words, if it fails.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline() or '{"error": "gsply ended"}')
        if "error" in answer:
            raise RuntimeError(f"gsply: {answer['error']}")
        return answer

    def close(self) -> None:
        """End its process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def gsply() -> Gsply | None:
    """gsply, if it is installed."""
    python = python_of("gsply")
    return Gsply(python) if python else None


def missing() -> Sequence[str]:
    """A sentence for each peer that is not there."""
    absent = [name for name in PYTHON_PEERS if python_of(name) is None]
    absent += [] if splat_transform() else ["splat-transform"]
    return [f"{name}: not installed; python -m benchmarks.peers installs it" for name in absent]
