"""A long task for a document, in its own thread behind a gate."""

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
    """A document, as needed by a simulation."""

    stage: Usd.Stage
    lock: threading.RLock
    publish: Callable[[Event], None]
    wake: Callable[[], None]


class Job(ABC):
    """A job; call `start` once.

    Args:
        host: Document of the stage.
        device: Compute device.
        changed: Called in the job's thread when the status changes.
    """

    def __init__(self, host: Host, device: Device, changed: Callable[[], None]) -> None:
        self.gate = Gate()
        self.failure = ""
        """Error message if the job failed."""
        self.is_over = False
        self._host, self._tell = host, changed
        self._compiled: Callable[[], None] = lambda: None
        self._reading = StageRead(host.lock, self.gate)
        self._device = GatedDevice(device, self.gate)
        self._thread = threading.Thread(target=self._run, name="usdsplat simulation", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def join(self) -> None:
        """Wait for the end of the thread; stop the gate before."""
        self._thread.join()

    @abstractmethod
    def work(self) -> None:
        """Do the work, in the job's thread."""

    def _run(self) -> None:
        try:
            with telling(self._host.publish) as self._compiled:
                self.work()
        except Stopped:
            self.is_over = True
            self._stopped()
            return
        except UsdSplatError as error:
            self.failure = str(error)
        except Exception:  # an unexpected exception must not end the window
            LOG.exception("a bug in a simulation")
            self.failure = "simulation: found an internal error, expected none; see the terminal"
        self.is_over = True
        self._changed()

    def _stopped(self) -> None:
        """Note that the job is over because its gate was stopped; nobody is told."""
        self._compiled()

    def _changed(self) -> None:
        """Report a changed status."""
        self._compiled()
        self._tell()
