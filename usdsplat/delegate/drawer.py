"""The renderer of an engine; its device is chosen and opened on first use."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass

from usdsplat.core.errors import UsageError
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.render_pass import RenderPass
from usdsplat.kernels.device import checked_name, checked_threads, usual_threads
from usdsplat.kernels.devices import open_device
from usdsplat.render.cost import Work
from usdsplat.render.renderer import Renderer


@dataclass(frozen=True, slots=True, eq=False)
class _Opened:
    renderer: Renderer
    render_pass: RenderPass


class Drawer:
    """A renderer of a render scene, with a pass that redraws only outdated pictures.

    Args:
        device: "auto", or a device name of `kernels.devices.open_device`.
        threads: Number of threads; None for all.

    Raises:
        BackendError: If the device name is unknown.
        UsageError: If the number of threads is out of range.
    """

    def __init__(self, param: RenderParam, device: str, threads: int | None) -> None:
        self._param = param
        self._device, self._threads = checked_name(device), checked_threads(threads)
        self._seconds: float | None = None
        self._opened: _Opened | None = None
        self._is_closed = False
        self._opening = threading.Lock()

    def expect(self, work: Iterable[Work]) -> None:
        """Announce what will be drawn. This has no effect after the device is open."""
        splats = self._param.scene.draw_list().total
        self._seconds = sum(each.seconds(splats, self._threads) for each in work)

    @property
    def threads(self) -> int:
        """Threads of the CPU that a picture may use; does not open the device."""
        return self._threads or usual_threads()

    @property
    def renderer(self) -> Renderer:
        """The renderer; opens the device."""
        return self._open().renderer

    @property
    def render_pass(self) -> RenderPass:
        """The pass that redraws only outdated pictures; opens the device."""
        return self._open().render_pass

    def close(self) -> None:
        """Close the renderer; it cannot be opened again."""
        self._is_closed = True
        if self._opened is not None:
            self._opened.renderer.close()

    def _open(self) -> _Opened:
        with self._opening:
            if self._opened is None:
                if self._is_closed:
                    raise UsageError("engine", "a closed one", "an open one")
                device = open_device(self._device, threads=self._threads, seconds=self._seconds)
                renderer = Renderer(device, falls_back=self._device == "auto")
                self._opened = _Opened(renderer, RenderPass(renderer, self._param))
            return self._opened
