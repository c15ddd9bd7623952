"""Other converters and renderers, each in a separate environment, for checks and timings.

    python -m benchmarks.peers

installs them into the folder `installed` beside this file, which git ignores, or into the folder of
the environment variable `USDSPLAT_PEERS`: gsply, usd-convert-gsplat and Open3D from PyPI; node 22,
splat-transform, PlayCanvas and Spark from npm, if npm is available. Chromium and Mesa's Vulkan
driver for CPUs come from the system; if they are missing, the names of their packages are printed.
Peers that are missing are reported, and left out of the tables.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.peers.server import Server

FOLDER = Path(os.environ.get("USDSPLAT_PEERS") or Path(__file__).parent / "installed")

PYTHON_PEERS = {
    "gsply": ("gsply[spz]==0.4.6", "imagecodecs"),
    "usd_convert": ("usd-convert-gsplat==0.1.15", "usd-core", "plyfile"),
    "open3d": ("open3d==0.20.0",),
}
"""Environment -> packages to install in it."""
NODE_PEERS = (
    "node@22",
    "@playcanvas/splat-transform@3.7.0",
    "playcanvas@2.23.3",
    "@sparkjsdev/spark@2.2.0",
    "playwright-core@1.65.1",
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
VULKAN_DRIVERS = Path("/usr/share/vulkan/icd.d")

_HERE = Path(__file__).parent


def python_of(peer: str) -> Path | None:
    """Return the Python interpreter of a peer's environment, if it is installed."""
    path = FOLDER / peer / "bin" / "python"
    return path if path.exists() else None


@dataclass(frozen=True, slots=True)
class SplatTransform:
    """PlayCanvas's converter, run with node."""

    node: Path
    script: Path

    def convert(self, source: Path, target: Path, *options: str) -> None:
        """Convert a file, with `-g cpu` because there may be no GPU.

        Raises:
            RuntimeError: If it fails, with its output.
        """
        command = [str(self.node), str(self.script), "-w", "-g", "cpu", str(source), *options]
        done = subprocess.run([*command, str(target)], capture_output=True, text=True, check=False)
        if done.returncode or not target.exists():
            raise RuntimeError(f"splat-transform: {(done.stderr or done.stdout).strip()[-300:]}")


def splat_transform() -> SplatTransform | None:
    """Return splat-transform, if it is installed."""
    modules = node_modules()
    found = SplatTransform(
        modules / "node" / "bin" / "node",
        modules / "@playcanvas" / "splat-transform" / "bin" / "cli.mjs",
    )
    return found if found.node.exists() and found.script.exists() else None


@dataclass(frozen=True, slots=True)
class Spark:
    """Spark's builder of trees of splats, run with node: that of its web worker, which has the same
    methods as its command build-lod. That command is Rust and not in the package."""

    node: Path
    package: Path

    def build(self, source: Path, how: str, folder: Path, counts: Sequence[int]) -> dict[str, Any]:
        """Build the tree of a .ply, and write it and cuts of it; see `spark_lod.mjs`.

        Args:
            how: "quick" or "quality".
            counts: Largest numbers of splats of the cuts.

        Raises:
            RuntimeError: If it fails, with its output.
        """
        command = [str(self.node), str(_HERE / "spark_lod.mjs"), str(self.package), str(source)]
        command += [how, str(folder), *map(str, counts)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode or not done.stdout:
            raise RuntimeError(f"Spark: {(done.stderr or done.stdout).strip()[-300:]}")
        report: dict[str, Any] = json.loads(done.stdout)
        return report


def spark() -> Spark | None:
    """Return Spark, if it is installed."""
    modules = node_modules()
    found = Spark(modules / "node" / "bin" / "node", modules / "@sparkjsdev" / "spark")
    return found if found.node.exists() and found.package.exists() else None


def gsply() -> Server | None:
    """Return gsply in a process that keeps running, so that its compiled code is warm, if it is
    installed."""
    python = python_of("gsply")
    return Server("gsply", [str(python), str(_HERE / "gsply_server.py")]) if python else None


def open3d() -> Server | None:
    """Return Open3D that draws with lavapipe, if both are installed."""
    python = python_of("open3d")
    if python is None or not has_lavapipe():
        return None
    return Server("Open3D", [str(python), str(_HERE / "open3d_server.py")])


def playcanvas() -> Server | None:
    """Return PlayCanvas. It receives the path of its browser when it opens a scene."""
    node = node_modules() / "node" / "bin" / "node"
    if not node.exists() or not (node_modules() / "playcanvas").exists() or browser() is None:
        return None
    return Server("PlayCanvas", [str(node), str(_HERE / "playcanvas_server.mjs")])


def browser() -> Path | None:
    """Return the path of Chromium, if it is installed."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    return Path(found) if found else None


def node_modules() -> Path:
    """Return the folder of npm's packages."""
    return FOLDER / "node" / "node_modules"


def has_lavapipe() -> bool:
    """Return whether Vulkan can draw on the CPU."""
    return any(VULKAN_DRIVERS.glob("lvp_icd*"))


def missing() -> Sequence[str]:
    """Return a sentence for each missing peer."""
    absent = [name for name in PYTHON_PEERS if python_of(name) is None]
    absent += [] if splat_transform() else ["splat-transform"]
    absent += [] if (node_modules() / "playcanvas").exists() else ["playcanvas"]
    absent += [] if spark() else ["spark"]
    said = [f"{name}: not installed; python -m benchmarks.peers installs it" for name in absent]
    if browser() is None:
        said.append("playcanvas: no browser; Debian's package is chromium")
    if not has_lavapipe():
        said.append("open3d: no Vulkan on the processor; Debian's package is mesa-vulkan-drivers")
    return said
