"""Forward numba-cuda's compile events to the listeners of Numba's."""

from __future__ import annotations

import os
from typing import Any

from numba.core import event

from usdsplat.kernels.compiling import SPENT, TOLD
from usdsplat.kernels.cuda.support import is_compiled

FIRST = "cuda_translate_bytecode "
"""Prefix of the first compiler pass of a function."""


def connect() -> None:
    """Connect numba-cuda, if it is installed, to the compile messages. Called once per process.

    Listeners of `kernels.compiling` receive numba-cuda's events from now on. numba-cuda's warnings
    on launches with few threads are switched off, because most of these launches have one thread on
    purpose. A user's own setting of these warnings is kept.
    """
    if not is_compiled():
        return
    from numba.cuda.core import config
    from numba.cuda.core import event as events

    if not os.environ.get("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS"):
        config.CUDA_LOW_OCCUPANCY_WARNINGS = 0

    class Functions(events.Listener):
        """Listener for functions, called at the first pass of each. Loaded functions have no
        passes."""

        def on_start(self, given: Any) -> None:
            if given.data["name"].startswith(FIRST):
                event.start_event(TOLD, {"name": given.data["qualname"].rpartition(".")[2]})

        def on_end(self, given: Any) -> None:
            if given.data["name"].startswith(FIRST):
                event.end_event(TOLD)

    class Locks(events.Listener):
        """Listener for the compiler's lock, which is held until a kernel is ready."""

        def on_start(self, given: Any) -> None:
            event.start_event(SPENT)

        def on_end(self, given: Any) -> None:
            event.end_event(SPENT)

    events.register("numba-cuda:run_pass", Functions())
    events.register("numba-cuda:compiler_lock", Locks())
