"""On what something was measured: processor, GPU, versions. The first line of every benchmark."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from usdsplat import __version__

PACKAGES = (
    "numpy", "numba", "numba-cuda", "cuda-cccl", "usd-core", "OpenImageIO", "gsplat", "torch",
)  # fmt: skip
"""Their versions are said where they are installed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A machine and what is installed on it."""

    cpu: str
    cores: int
    """That this process may use."""
    memory: int
    """[GiB]"""
    gpu: str
    """Name and driver, empty if there is none."""
    versions: dict[str, str]

    @property
    def line(self) -> str:
        """Everything in one line."""
        hardware = [f"{self.cpu}, {self.cores} cores, {self.memory} GiB"]
        hardware += [self.gpu] if self.gpu else []
        return "; ".join([*hardware, ", ".join(f"{k} {v}" for k, v in self.versions.items())])

    def as_json(self) -> dict[str, Any]:
        """Plain values; `Machine(**values)` takes them back."""
        return asdict(self)


def this_machine() -> Machine:
    """What this process runs on."""
    versions = {"usdsplat": __version__, "Python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return Machine(
        cpu=_cpu(),
        cores=_cores(),
        memory=round(pages / 2**30),
        gpu=_gpu(),
        versions=versions,
    )


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cpu() -> str:
    """Its name, where Linux knows it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _gpu() -> str:
    """Name and driver of the first GPU."""
    tool = shutil.which("nvidia-smi")
    if tool is None:
        return ""
    query = [tool, "--query-gpu=name,driver_version", "--format=csv,noheader"]
    done = subprocess.run(query, capture_output=True, text=True, check=False)
    name, _, driver = done.stdout.partition("\n")[0].partition(", ")
    return f"{name}, driver {driver}" if done.returncode == 0 and driver else ""
