"""Compile all kernels ahead of time, so that later commands do not wait for it.

examples:
  usdsplat compile
      for this machine: its CPU, and its GPU if there is one
  usdsplat compile --device cpu --cache-dir /opt/usdsplat-kernels
      for a container image; set USDSPLAT_CACHE_DIR to that folder in the image
  usdsplat compile --device cuda --capability 8.9,9.0
      for GPUs of other machines; no driver is needed

notes:
  Kernels are stored in USDSPLAT_CACHE_DIR, or in the user's cache folder. A stored kernel is
  compiled again only if its sources, the versions of the compilers or the type of processor differ.
  An image must therefore be made on the type of processor that it runs on. In the image, the folder
  may be read-only.
  The GPU's sorting kernels can only be compiled on a GPU of the same capability. If --capability
  names another one, these kernels are left out. The first process that needs them then compiles
  them, which takes up to half a minute.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.core.errors import BackendError, UsageError
from usdsplat.core.text import shown
from usdsplat.core.wording import counted
from usdsplat.kernels.cuda.support import Capability

USES_USD = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat compile`."""

    device: Annotated[str, option("auto|cpu|cuda")] = "auto"
    """device to compile for; default: auto, all devices of this machine"""
    capability: Annotated[str | None, option("X.Y,...")] = None
    """compute capabilities of the GPUs; default: that of this machine's GPU"""
    cache_dir: Annotated[str | None, option("DIR")] = None
    """folder for the kernels; default: USDSPLAT_CACHE_DIR, or the user's cache folder"""
    jobs: Annotated[int | None, option("N")] = None
    """number of processes that compile at the same time; default: one per core"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the folder and the number of kernels"""
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Compile all kernels. Print their number and folder."""
    from usdsplat.kernels import ahead, store

    if options.cache_dir is not None:
        if not options.cache_dir:
            raise UsageError("--cache-dir", "''", "a folder")
        store.use(Path(options.cache_dir).absolute())
    if options.jobs is not None and options.jobs < 1:
        raise UsageError("--jobs", str(options.jobs), "1 or more")
    if not store.save(store.key_of("compile"), b""):
        raise UsageError("--cache-dir", store.refusal(), "a folder that can be written")
    targets = _targets(options)
    tasks = [task for each in targets for task in ahead.tasks(*each)]
    with reporter.progress() as progress:
        failed = ahead.compile_all(tasks, jobs=options.jobs, progress=progress)
    for task, problem in failed:
        reporter.remark(f"{task.name} for {task.device}: {problem}")
    if failed:
        found = f"{counted(len(failed), 'kernel')} of {len(tasks)} that failed"
        raise BackendError("compile", found, "none")
    for each in targets:
        ahead.note(*each)
    if options.json:
        console.print_json({"folder": str(store.folder()), "kernels": len(tasks)})
    else:
        console.say(f"{shown(store.folder())}: {counted(len(tasks), 'kernel')}")
    return 0


def _targets(options: Options) -> list[tuple[str, Capability | None]]:
    """Return (device, compute capability) pairs; the capability of the CPU is None.

    Raises:
        UsageError: If the options contradict each other or name no capability.
        BackendError: If a GPU was requested and neither it nor its compiler is available.
    """
    from usdsplat.kernels.cuda.support import INSTALL, capability, is_compiled, obstacle
    from usdsplat.kernels.device import DEVICES

    if options.device not in ("auto", *DEVICES):
        raise UsageError("--device", repr(options.device), f"auto, {' or '.join(DEVICES)}")
    targets: list[tuple[str, Capability | None]] = []
    if options.device != "cuda":
        targets.append(("cpu", None))
    if options.capability is not None:
        if options.device == "cpu":
            raise UsageError("--capability", "--device cpu", "--device cuda or auto")
        targets += [("cuda", each) for each in _capabilities(options.capability)]
        if not is_compiled():
            raise BackendError("--capability", "no package numba-cuda", INSTALL)
    elif options.device == "cuda" or (options.device == "auto" and obstacle() is None):
        missing_here = obstacle()
        if missing_here is not None:
            found, expected = missing_here
            raise BackendError("device cuda", found, f"{expected}, or --capability")
        targets.append(("cuda", capability()))
    return targets


def _capabilities(text: str) -> list[Capability]:
    found = [re.fullmatch(r"(\d+)\.(\d)", part.strip()) for part in text.split(",")]
    if not all(found):
        raise UsageError("--capability", repr(text), "numbers such as 8.9 or 8.0,9.0")
    return [(int(each[1]), int(each[2])) for each in found if each]
