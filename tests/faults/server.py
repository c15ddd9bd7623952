"""Run commands in children of a process that has imported everything, with faults.

Reads a line of JSON for each command: "arguments", "folder" (to run in), "fault" (root, mode and
number of `fault_arm` in `shim.c`, or null), "log", and "limit" (largest size of a file [byte], or
null). Writes a line of JSON with the exit status, negative for a signal, and stderr.

A child is forked before any thread is started, and ends without returning here.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import resource
import signal
import sys
import traceback
from typing import Any

MODULES = (
    "pxr.UsdUtils",
    "pxr.UsdRender",
    "OpenImageIO",
    "usdsplat.cli.convert",
    "usdsplat.cli.render",
    "usdsplat.cli.simulate",
    "usdsplat.cli.parsing",
    "usdsplat.interchange",
    "usdsplat.delegate.engine",
    "usdsplat.products.drawing",
    "usdsplat.sim.stage.simulating",
    "usdsplat.kernels.device",
    "usdsplat.formats.ply",
    "usdsplat.formats.spz",
    "usdsplat.formats.sog",
    "PIL.Image",
)


def run(task: dict[str, Any]) -> int:
    """Run a command in this process, and return its exit status."""
    os.dup2(os.open(os.devnull, os.O_RDWR), 1)
    os.chdir(task["folder"])
    if task["limit"] is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (task["limit"], task["limit"]))
    if task["fault"] is not None:
        root, mode, number = task["fault"]
        shim = ctypes.CDLL(None)
        shim.fault_arm(root.encode(), mode.encode(), number, task["log"].encode())
    from usdsplat.cli.main import main

    try:
        return main(task["arguments"])
    except BaseException:
        traceback.print_exc()
        return 1


def serve() -> None:
    """Run the commands of stdin, each in a child."""
    for module in MODULES:
        importlib.import_module(module)
    for line in sys.stdin:
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            status = 1
            try:
                os.dup2(writing, 2)
                os.close(writing)
                status = run(json.loads(line))
                sys.stderr.flush()
            finally:
                os._exit(status)
        os.close(writing)
        with open(reading, errors="replace") as pipe:
            said = pipe.read()
        _, found = os.waitpid(child, 0)
        print(json.dumps([os.waitstatus_to_exitcode(found), said]), flush=True)


if __name__ == "__main__":
    serve()
