"""Choose a device and open it."""

from __future__ import annotations

from usdsplat.core.errors import BackendError, UsdSplatError
from usdsplat.kernels.device import CpuDevice, Device, checked_name

START = 1.5
"""[s] That a GPU takes from the beginning of a process to its first picture, besides what the CPU
takes."""
COMPILING = 60.0
"""[s] That its kernels take where they were not compiled ahead."""


def automatic(task: str, seconds: float | None = None) -> tuple[str, str]:
    """Return the device that "auto" is, and a remark, mostly empty: where a faster one would have
    to be prepared first.

    Pictures are drawn by a GPU where that is done sooner, its start and what it has to compile
    counted. Geometry is the CPU's: between kernels of simulations arrays would cross the bus, and a
    frame takes longer on a GPU at every size that was measured.

    Args:
        task: "pictures" or "geometry".
        seconds: About what the task takes on the CPU; None if nobody knows when it ends.
    """
    from usdsplat.kernels import ahead
    from usdsplat.kernels.cuda.support import capability, obstacle

    here = capability() if task == "pictures" else None
    if here is None:
        return "cpu", ""
    is_ready = ahead.is_noted("cuda", here)
    if seconds is None:
        if is_ready:
            return "cuda", ""
        found, expected = obstacle() or ("kernels not compiled yet", "'usdsplat compile' once")
        return "cpu", f"device cuda: found {found}, expected {expected}"
    return ("cuda", "") if seconds > START + (0 if is_ready else COMPILING) else ("cpu", "")


def open_device(
    name: str = "auto",
    *,
    threads: int | None = None,
    task: str = "pictures",
    seconds: float | None = None,
) -> Device:
    """Return the device called `name`; "auto" is what `automatic` says of `task` and `seconds`, or
    the CPU where a GPU cannot be used, and then its `remark` says why.

    Raises:
        BackendError: If no such device is usable here.
        UsageError: If `threads` is out of range.
    """
    chosen, remark = automatic(task, seconds) if checked_name(name) == "auto" else (name, "")
    if chosen == "cpu":
        return CpuDevice(threads=threads, remark=remark)
    from usdsplat.kernels.cuda.support import obstacle

    missing = obstacle()
    if missing is None:
        try:
            from usdsplat.kernels.cuda.device import CudaDevice

            return CudaDevice(threads=threads)
        except UsdSplatError:
            raise
        except Exception as error:  # of a driver too old for a package, or a GPU that is taken
            found = f"a GPU that does not start ({type(error).__name__}: {error})"
            missing = " ".join(found.split()), "one that does"
    if name == "cuda":
        raise BackendError("device cuda", *missing)
    remark = f"device cuda: found {missing[0]}, expected {missing[1]}; the CPU does the work"
    return CpuDevice(threads=threads, remark=remark)
