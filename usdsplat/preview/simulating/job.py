"""A piece of work for a document that takes long, in a thread of its own behind a gate."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from pxr import Usd

from usdsplat.core.errors import UsdSplatError
from usdsplat.kernels.device import Device
from usdsplat.preview.compiling import telling
from usdsplat.preview.simulating.gate import Gate, GatedDevice, StageRead, Stopped
from usdsplat.preview.values import Event

LOG = logging.getLogger("usdsplat")


class Host(Protocol):
    """What a simulation needs of a document."""

    stage: Usd.Stage
    lock: threading.RLock
    publish: Callable[[Event], None]
    wake: Callable[[], None]


class Job(ABC):
    """One job; `start` it once.

    Args:
        host: Whose stage it is.
        device: Computes.
        changed: Called, in the job's thread, when there is something new to say.
    """

    def __init__(self, host: Host, device: Device, changed: Callable[[], None]) -> None:
        self.gate = Gate()
        self.failure = ""
        """Why it does not go on, a sentence."""
        self.is_over = False
        self._host, self._tell = host, changed
        self._compiled: Callable[[], None] = lambda: None
        self._reading = StageRead(host.lock, self.gate)
        self._device = GatedDevice(device, self.gate)
        self._thread = threading.Thread(target=self._run, name="usdsplat simulation", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def join(self) -> None:
        """Wait for the end; the gate should be stopped."""
        self._thread.join()

    @abstractmethod
    def work(self) -> None:
        """All of it, in the job's thread."""

    def _run(self) -> None:
        try:
            with telling(self._host.publish) as self._compiled:
                self.work()
        except Stopped:
            self.is_over = True
            return
        except UsdSplatError as error:
            self.failure = str(error)
        except Exception:  # a bug must not take the window with it
            LOG.exception("a bug in a simulation")
            self.failure = "simulation: found a bug, expected none; see the terminal"
        self.is_over = True
        self._changed()

    def _changed(self) -> None:
        """There is something new to say."""
        self._compiled()
        self._tell()
