"""Pause or stop a simulation's thread, between two pieces of its work.

A piece is a kernel, or a look at the stage. A piece that has begun is finished, and no lock is held
while the thread waits at its gate.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any

from usdsplat.kernels.device import Device

_PATIENCE = 0.1
"""How long the lock is waited for before somebody is asked whether it is needed still [s]."""


class Stopped(BaseException):
    """Nobody wants the rest of the work. No error, so that nobody takes it for one."""


class Gate:
    """Lets work go on for some frames, for ever, or not at all."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frames = math.inf
        self._is_stopped = False
        self.held = 0.0
        """How long work was held so far [s]."""

    @property
    def is_open(self) -> bool:
        """Whether work goes on."""
        return self._frames > 0 and not self._is_stopped

    def open(self, frames: float = math.inf) -> None:
        """Let work go on until so many frames are done."""
        with self._changed:
            self._frames = frames
            self._changed.notify_all()

    def hold(self) -> None:
        """Let work wait at its next piece."""
        self.open(0)

    def stop(self) -> None:
        """Let work end at its next piece, for good."""
        with self._changed:
            self._is_stopped = True
            self._changed.notify_all()

    def frame_done(self) -> None:
        """Count a frame."""
        with self._changed:
            self._frames = max(0, self._frames - 1)

    def check(self) -> None:
        """Wait while work is held.

        Raises:
            Stopped: If it is not wanted any more.
        """
        with self._changed:
            if not self.is_open:
                began = time.perf_counter()
                self._changed.wait_for(lambda: self.is_open or self._is_stopped)
                self.held += time.perf_counter() - began
        self.go_on()

    def go_on(self) -> None:
        """Do not wait.

        Raises:
            Stopped: If the work is not wanted any more.
        """
        if self._is_stopped:
            raise Stopped

    def rest(self, seconds: float) -> None:
        """Wait so long, or until work is held or stopped."""
        with self._changed:
            self._changed.wait_for(lambda: not self.is_open, timeout=max(0.0, seconds))


class GatedDevice:
    """A device whose every kernel is a piece of work; all else is the device's own.

    Args:
        device: Computes.
        gate: Passed before each kernel.
    """

    def __init__(self, device: Device, gate: Gate) -> None:
        self._device, self._gate = device, gate
        self.name, self.threads, self.remark = device.name, device.threads, device.remark
        self.upload, self.keep, self.fetch = device.upload, device.keep, device.fetch
        self.empty, self.resident, self.close = device.empty, device.resident, device.close
        self.move, self.publish = device.move, device.publish

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """As the device's own, when the gate is open."""
        self._gate.check()
        return self._device.run(kernel, *args)


class StageRead(AbstractContextManager[None]):
    """Reentrant hold of a stage's lock, for one thread that works behind a gate.

    Args:
        lock: Of the stage.
        gate: Passed before the lock is taken, never while it is held. Work that is stopped does not
            get the lock.
    """

    def __init__(self, lock: threading.RLock, gate: Gate) -> None:
        self._lock, self._gate = lock, gate
        self._depth = 0

    def __enter__(self) -> None:
        if not self._depth:
            self._gate.check()
            while not self._lock.acquire(timeout=_PATIENCE):
                self._gate.go_on()
            try:
                self._gate.go_on()
            except Stopped:
                self._lock.release()
                raise
        self._depth += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._depth -= 1
        if not self._depth:
            self._lock.release()
