"""Devices that tests run on; missing ones are skipped with the reason."""

from __future__ import annotations

import functools

import pytest

from usdsplat.kernels.cuda.support import is_simulated, obstacle
from usdsplat.kernels.device import CpuDevice, Device, cores
from usdsplat.kernels.devices import open_device

NAMES = ("cpu", "cuda")


@functools.cache
def _opened(name: str) -> Device:
    return open_device(name)


def device_of(name: str) -> Device:
    """One of NAMES; a test that asks for a GPU skips visibly where there is none."""
    if name == "cuda":
        missing = obstacle()
        if missing is not None or is_simulated():
            pytest.skip(f"device cuda: found {missing[0] if missing else 'a simulated GPU'}")
    return _opened(name)


def here() -> list[str]:
    """Those of NAMES that this machine has."""
    usable = obstacle() is None and not is_simulated()
    return [name for name in NAMES if name == "cpu" or usable]


def all_cores() -> CpuDevice:
    """The CPU with all its cores. Tests that do not ask for them get USDSPLAT_THREADS."""
    return CpuDevice(threads=cores())
