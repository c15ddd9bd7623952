"""A job whose frames are shown on the stage of its document while it computes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from pxr import Sdf, Usd

from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live_layer import LiveLayer
from usdsplat.sim.stage.plan import BakedField
from usdsplat.sim.stage.twins import in_session, leave_session
from usdsplat.sim.state import Frame


class ShownJob(Job):
    """A job with frames.

    Args:
        host: Document of the stage.
        device: Computes.
        changed: Called when the status changes.
        budget: As for `LiveLayer`.
    """

    def __init__(
        self, host: Host, device: Device, changed: Callable[[], None], *, budget: float | None
    ) -> None:
        super().__init__(host, device, changed)
        self.layer: LiveLayer | None = None
        """The frames; access only with the stage's lock."""
        self.frame: float | None = None
        """Time of the last frame [time code]."""
        self.frames: tuple[float, float] | None = None
        """First and last frame that can be shown [time code]."""
        self.end: float | None = None
        self.splats = 0
        self.seconds = 0.0
        self.message = ""
        self.notes: tuple[str, ...] = ()
        """Sentences about what was chosen for the user."""
        self._budget = budget
        self._is_removed = False
        self._refined: Sdf.Layer | None = None
        """Layer of refined captures, below that of the frames."""

    @property
    def layers(self) -> list[str]:
        """Identifiers of the layers that the job adds to the session."""
        own = self.layer.identifier if self.layer else ""
        refined = self._refined.identifier if self._refined else ""
        return [name for name in (own, refined) if name]

    def remove(self) -> None:
        """Remove these layers; requires the stage's lock."""
        self._is_removed = True
        if self.layer is not None:
            self.layer.remove()
        if self._refined is not None:
            leave_session(self._host.stage, self._refined)

    # --- for the job's thread ---------------------------------------------------------------

    def _compose(self, stage: Usd.Stage, layer: Sdf.Layer) -> Usd.Stage:
        """Show refined captures on a stage; requires its lock."""
        self._refined = layer
        return in_session(stage, layer)

    def _open_layer(self, fields: Sequence[BakedField]) -> None:
        """Begin to show frames; requires the stage's lock."""
        self.layer = LiveLayer(self._host.stage, fields, budget=self._budget)

    def _show(self, time: float, frames: Mapping[str, Frame], *, is_last: bool) -> None:
        """Show a frame, as a value or on the stage, within the budget."""
        layer = self.layer
        assert layer is not None
        layer.put(time, frames)
        if layer.is_empty or layer.is_over or is_last or not self.gate.is_endless:
            with self._reading:
                if layer.is_over and not (layer.is_empty or is_last):
                    layer.trim()
                else:
                    layer.author()
        with self._host.lock:  # whoever has it may author or drop frames
            self.frame, self.frames = time, layer.frames
