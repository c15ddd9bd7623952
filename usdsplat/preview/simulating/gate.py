"""Pause or stop a simulation's thread between units of work.

A unit is a kernel, or one access of the stage. A unit that has begun is finished, and no lock is
held while the thread waits at its gate.
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
"""Interval at which a thread that waits for the lock checks whether it is stopped [s]."""


class Stopped(BaseException):
    """The work is cancelled. It is no Exception, so that error handlers do not catch it."""


class Gate:
    """A gate that lets work run for some frames, without limit, or not at all."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frames = math.inf
        self._is_stopped = False
        self.held = 0.0
        """Total time for which work was held [s]."""

    @property
    def is_open(self) -> bool:
        """Whether work may run."""
        return self._frames > 0 and not self._is_stopped

    @property
    def is_stopped(self) -> bool:
        """Whether work was stopped."""
        return self._is_stopped

    @property
    def is_endless(self) -> bool:
        """Whether work may run without limit."""
        return math.isinf(self._frames)

    def open(self, frames: float = math.inf) -> None:
        """Let work run for a number of frames."""
        with self._changed:
            self._frames = frames
            self._changed.notify_all()

    def hold(self) -> None:
        """Hold work at its next unit."""
        self.open(0)

    def stop(self) -> None:
        """Stop work at its next unit, permanently."""
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
            Stopped: If the work is stopped.
        """
        with self._changed:
            if not self.is_open:
                began = time.perf_counter()
                self._changed.wait_for(lambda: self.is_open or self._is_stopped)
                self.held += time.perf_counter() - began
        self.go_on()

    def go_on(self) -> None:
        """Check without waiting.

        Raises:
            Stopped: If the work is stopped.
        """
        if self._is_stopped:
            raise Stopped

    def rest(self, seconds: float) -> None:
        """Wait for a time, or until work is held or stopped."""
        with self._changed:
            self._changed.wait_for(lambda: not self.is_open, timeout=max(0.0, seconds))


class GatedDevice:
    """A device that passes a gate before each kernel; all else is forwarded.

    Args:
        device: The device.
        gate: Gate that is passed before each kernel.
    """

    def __init__(self, device: Device, gate: Gate) -> None:
        self._device, self._gate = device, gate
        self.name, self.threads, self.remark = device.name, device.threads, device.remark
        self.upload, self.keep, self.fetch = device.upload, device.keep, device.fetch
        self.empty, self.resident, self.close = device.empty, device.resident, device.close
        self.move, self.publish = device.move, device.publish
        self.copied = device.copied

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Run a kernel on the device when the gate is open."""
        self._gate.check()
        return self._device.run(kernel, *args)


class StageRead(AbstractContextManager[None]):
    """Reentrant context of a stage's lock, for one thread behind a gate.

    Args:
        lock: Lock of the stage.
        gate: Gate that is passed before the lock is taken, never while it is held. Stopped work
            does not get the lock.
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
