"""What numba-cuda compiles is told of as what Numba does: it has events of its own."""

from __future__ import annotations

import os
from typing import Any

from numba.core import event

from usdsplat.kernels.compiling import SPENT, TOLD
from usdsplat.kernels.cuda.support import is_compiled

FIRST = "cuda_translate_bytecode "
"""The pass that a function is compiled by first."""


def connect() -> None:
    """Set numba-cuda up for what users read, where it is; once for each process.

    Who listens by `kernels.compiling` hears of it from now on, and it no longer warns of each
    launch of few threads: most of those are of one, on purpose. A user's own wish to be warned
    is left alone.
    """
    if not is_compiled():
        return
    from numba.cuda.core import config
    from numba.cuda.core import event as events

    if not os.environ.get("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS"):
        config.CUDA_LOW_OCCUPANCY_WARNINGS = 0

    class Functions(events.Listener):
        """Functions, each as its first pass begins; what is loaded goes through none."""

        def on_start(self, given: Any) -> None:
            if given.data["name"].startswith(FIRST):
                event.start_event(TOLD, {"name": given.data["qualname"].rpartition(".")[2]})

        def on_end(self, given: Any) -> None:
            if given.data["name"].startswith(FIRST):
                event.end_event(TOLD)

    class Locks(events.Listener):
        """The compiler's lock, which is held until a kernel is ready."""

        def on_start(self, given: Any) -> None:
            event.start_event(SPENT)

        def on_end(self, given: Any) -> None:
            event.end_event(SPENT)

    events.register("numba-cuda:run_pass", Functions())
    events.register("numba-cuda:compiler_lock", Locks())
