"""A previewed stage with its engines and state; used by one thread at a time.

`Session` passes it from task to task. Only tasks access the stage, and a simulation, which takes
`lock` while it reads or writes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd, UsdGeom

from usdsplat.core.cancel import CancelToken
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate.light_groups import find_lights, light_aovs
from usdsplat.interchange.provenance import KEY
from usdsplat.kernels.device import CpuDevice
from usdsplat.preview import boxes
from usdsplat.preview.compiling import telling
from usdsplat.preview.display import Display
from usdsplat.preview.drawing import Drawing
from usdsplat.preview.drawing_progress import telling_phases
from usdsplat.preview.scenes import Scenes
from usdsplat.preview.sides import Shown
from usdsplat.preview.sources import Sources
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.overlay_finder import OverlayFinder
from usdsplat.preview.values import Event, Opened, StageChanged, ViewState
from usdsplat.render.fields import Box
from usdsplat.render.subject import Subject, of_box
from usdsplat.schema.stage_values import up_axis
from usdsplat.sim.stage.collections import find_simulations
from usdsplat.sim.stage.provenance import baked_frames


class Document:
    """A stage and its pictures.

    Args:
        stage: The stage. Edits go to its session layer.
        path: File of the stage; None for a stage in memory.
        device, threads: As for `Engine`.
        publish: Receives events.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        *,
        path: Path | None = None,
        device: str = "auto",
        threads: int | None = None,
        publish: Callable[[Event], None] = lambda event: None,
    ) -> None:
        self.stage = stage
        self.path = path
        self.sources: Sources | None = None
        """Files that it was read from; None for a stage in memory."""
        self.lock = threading.RLock()
        """Lock for reading or writing the stage."""
        self.publish = publish
        self.wake: Callable[[], None] = lambda: None
        """Function that tells the session that the stage may have changed, or that nodes of splat
        trees were read; callable from any thread."""
        self.edits = Edits(stage)
        """Edits of the session layer, with undo."""
        self.simulation: Any = None
        """The `Runner` of the stage's simulations; None without simulations."""
        self.engine = Engine(stage, device=device, threads=threads)
        self._scenes = Scenes(
            self.engine,
            lambda time: Engine(stage, device=device, threads=threads, time=time),
            up_axis=up_axis(stage),
            on_read=lambda: self.wake(),
            live=lambda: self.simulation,
        )
        self._thread = threading.get_ident()
        self._change: StageChanged | None = None
        self._changes = 0
        """Number of changes of the stage, by anyone."""
        self._notice = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._note_change, stage)
        self._overlays = OverlayFinder(stage)
        display = Display(CpuDevice(threads=threads))  # pictures are in host memory already
        self._drawing = Drawing(self._scenes, display, lambda: self._changes)

    @property
    def shown(self) -> Shown | None:
        """State and arrays of the last picture; None before the first."""
        return self._drawing.shown

    def opened(self) -> Opened:
        """Return the properties of the stage that a window needs first."""
        stage = self.stage
        with self.lock, telling(self.publish):
            has_range = stage.HasAuthoredTimeCodeRange()
            return Opened(
                name=self.path.name if self.path else stage.GetRootLayer().GetDisplayName(),
                start=stage.GetStartTimeCode() if has_range else 0.0,
                end=stage.GetEndTimeCode() if has_range else 0.0,
                rate=stage.GetTimeCodesPerSecond(),
                up_axis=up_axis(stage),
                cameras=tuple(self.engine.cameras()),
                has_simulation=bool(find_simulations(stage)),
                lights=light_aovs(find_lights(stage)),
                axes=self._axes("frame"),
                axes_are_assumed=self._axes("frame_source") == "assumed",
                baked=baked_frames(stage),
            )

    def draw(self, state: ViewState, cancel: CancelToken | None = None) -> bool:
        """Draw a new picture and publish it.

        A picture does not wait for the nodes of splat trees: `wake` is called when some were read,
        and the next call draws them.

        Edits of the stage since the last call are published first, once.

        Args:
            state: State of the viewport.
            cancel: Ends the picture after its current stage; nothing is published then.

        Returns:
            Whether to call this again at once, for a picture of higher quality, or to prepare the
            next movement.

        Raises:
            UsdSplatError: If the state cannot be drawn.
        """
        change, self._change = self._change, None
        if change is not None:
            if change.structure:
                self._overlays.forget()
            if self.simulation is not None:
                self.simulation.look(has_new_prims=change.structure)
            self.publish(change)
        with telling(self.publish), telling_phases(self.publish):
            picture = self._drawing.draw(state, self.lock, self._overlays.find, cancel=cancel)
        if picture is None:
            return False
        self.publish(picture)
        if picture.is_final:
            return not self._drawing.is_prepared
        return not state.is_moving

    def still(self, state: ViewState) -> Shown:
        """Return a full-quality picture of a state without publishing it; `shown` stays.

        Raises:
            UsdSplatError: If the state cannot be drawn.
        """
        still, before = replace(state, is_moving=False), self.shown
        with telling(self.publish):
            self._drawing.draw(still, self.lock, self._overlays.find, is_still=True)
        found = self.shown
        assert found is not None
        self._drawing.put_back(before)
        return found

    def bounds(self, paths: tuple[str, ...] = ()) -> Box | None:
        """Return the box to frame, in the world at the current time; None if it is empty.

        Args:
            paths: Paths of prims, including their descendants; empty for everything visible.
        """
        with self.lock:
            if not paths:
                return self.engine.render_scene.subject()
            corners = [
                corner for path in paths for corner in self._overlays.outline(self.engine, path)
            ]
        return boxes.around(corners)

    def subject(self, paths: tuple[str, ...] = ()) -> Subject | None:
        """Return what to frame, in the world at the current time; None if it is empty.

        Args:
            paths: Paths of prims, including their descendants; empty for everything visible.
        """
        with self.lock:
            found = self.engine.render_scene.seen(paths)
        box = self.bounds(paths) if found is None else None
        return found if box is None else of_box(box)

    @property
    def has_trees(self) -> bool:
        """Whether splat trees are drawn at the current time."""
        with self.lock:
            return bool(self.engine.render_scene.drawn_trees())

    def frame_anew(self) -> None:
        """Let the default camera frame the current scene again."""
        self._scenes.frame_anew()

    def close(self) -> None:
        """Release everything."""
        self._notice.Revoke()
        if self.simulation is not None:
            self.simulation.close()
        self.simulation = None
        self.edits.close()
        with self.lock:
            self._drawing.close()
            self._scenes.close()
            self.engine.close()

    # --- private ---------------------------------------------------------------------------

    def _axes(self, name: str) -> str:
        """Return what the import of a capture recorded of its axes; "" for a stage."""
        if self.sources is None or not self.sources.is_capture:
            return ""
        records = (prim.GetCustomDataByKey(KEY) for prim in self.stage.Traverse())
        found = next((each for each in records if isinstance(each, dict)), {})
        return str(found.get(name, ""))

    def _note_change(self, notice: Usd.Notice.ObjectsChanged, stage: Usd.Stage) -> None:
        """Record a change of the stage.

        Changes by a simulation, which writes in a separate thread, are not recorded as edits:
        panels would query all the time."""
        self._changes += 1
        if threading.get_ident() != self._thread:
            return
        others = any(path.IsAbsoluteRootOrPrimPath() for path in notice.GetResyncedPaths())
        ranges = Sdf.Path.absoluteRootPath in notice.GetChangedInfoOnlyPaths()
        changed = (*notice.GetResyncedPaths(), *notice.GetChangedInfoOnlyPaths())
        hidings = any(path.name == UsdGeom.Tokens.visibility for path in changed)
        before = self._change or StageChanged(structure=False)
        self._change = StageChanged(
            structure=others or ranges or before.structure,
            visibility=hidings or before.visibility,
        )
