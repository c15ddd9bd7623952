"""Describe the machine: processor, GPU, versions. This is the first line of every benchmark."""

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
"""Packages whose versions are included if they are installed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A machine and its installed packages."""

    cpu: str
    cores: int
    """Number of cores that this process may use."""
    memory: int
    """[GiB]"""
    gpu: str
    """Name and driver, empty if there is none."""
    versions: dict[str, str]

    @property
    def line(self) -> str:
        """Return the description in one line."""
        hardware = [f"{self.cpu}, {self.cores} cores, {self.memory} GiB"]
        hardware += [self.gpu] if self.gpu else []
        return "; ".join([*hardware, ", ".join(f"{k} {v}" for k, v in self.versions.items())])

    def as_json(self) -> dict[str, Any]:
        """Return plain values; `Machine(**values)` converts them back."""
        return asdict(self)


def this_machine() -> Machine:
    """Return the machine of this process."""
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
    """Return the processor's name, if Linux reports it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _gpu() -> str:
    """Return name and driver of the first GPU."""
    tool = shutil.which("nvidia-smi")
    if tool is None:
        return ""
    query = [tool, "--query-gpu=name,driver_version", "--format=csv,noheader"]
    done = subprocess.run(query, capture_output=True, text=True, check=False)
    name, _, driver = done.stdout.partition("\n")[0].partition(", ")
    return f"{name}, driver {driver}" if done.returncode == 0 and driver else ""
