"""Record launches once and replay them as one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from usdsplat.kernels.cuda.support import is_simulated


def record(stream: Any, launches: Callable[[], None]) -> Callable[[], None]:
    """Return a function that replays `launches` on `stream`, with the present arrays and numbers.

    They run once before the recording, so that everything is compiled and allocated. Kernels must
    be launched on `stream`, and nothing may wait for them.
    """
    launches()
    if is_simulated():
        return launches
    return _Graph(stream, launches)


class _Graph:
    def __init__(self, stream: Any, launches: Callable[[], None]) -> None:
        from cuda.bindings import driver

        self._driver = driver
        handle = stream.handle
        self._stream = driver.CUstream(int(getattr(handle, "value", None) or handle))
        stream.synchronize()
        mode = driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_RELAXED
        self._check(driver.cuStreamBeginCapture(self._stream, mode))
        try:
            launches()
        finally:
            graph = self._check(driver.cuStreamEndCapture(self._stream))
        self._graph = self._check(driver.cuGraphInstantiate(graph, 0))
        self._check(driver.cuGraphDestroy(graph))

    def __call__(self) -> None:
        self._check(self._driver.cuGraphLaunch(self._graph, self._stream))

    def __del__(self) -> None:
        graph = getattr(self, "_graph", None)
        if graph is not None:
            self._driver.cuGraphExecDestroy(graph)

    def _check(self, answer: Any) -> Any:
        """Return the result of a driver call, or raise an error."""
        if answer[0] != self._driver.CUresult.CUDA_SUCCESS:
            raise RuntimeError(f"CUDA: {answer[0]}")
        return answer[1] if len(answer) > 1 else None
