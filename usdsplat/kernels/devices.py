"""Choose a device and open it."""

from __future__ import annotations

from usdsplat.core.errors import BackendError, UsdSplatError
from usdsplat.kernels.device import CpuDevice, Device, checked_name

START = 1.5
"""Additional time of a GPU, relative to the CPU, from the start of a process to the first picture
[s]."""
COMPILING = 60.0
"""Time to compile the GPU's kernels if they are not stored [s]."""


def automatic(task: str, seconds: float | None = None) -> tuple[str, str]:
    """Return the device that "auto" selects, and a remark, which is usually empty.

    The remark says how to prepare a faster device.

    A GPU draws pictures if that takes less time, including its start and compilation. The CPU
    computes geometry: simulations would transfer arrays between kernels, and a frame took longer on
    a GPU at every measured size.

    Args:
        task: "pictures" or "geometry".
        seconds: Estimated time of the task on the CPU; None if its end is unknown.
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


def check_gpu() -> None:
    """Raise the error of `open_device` for a GPU that this machine does not have, without opening
    one.

    Raises:
        BackendError: If kernels cannot run on a GPU here.
    """
    from usdsplat.kernels.cuda.support import obstacle

    if missing := obstacle():
        raise BackendError("device cuda", *missing)


def open_device(
    name: str = "auto",
    *,
    threads: int | None = None,
    task: str = "pictures",
    seconds: float | None = None,
) -> Device:
    """Open the device `name`.

    "auto" is resolved by `automatic` for `task` and `seconds`. If a GPU cannot be used then, it is
    the CPU, and its `remark` contains the reason.

    Raises:
        BackendError: If the device cannot be used on this machine.
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
        except Exception as error:  # for example an outdated driver, or a GPU in exclusive use
            found = f"a GPU that cannot be started ({type(error).__name__}: {error})"
            missing = " ".join(found.split()), "a working GPU"
    if name == "cuda":
        raise BackendError("device cuda", *missing)
    remark = f"device cuda: found {missing[0]}, expected {missing[1]}; the CPU is used"
    return CpuDevice(threads=threads, remark=remark)
