"""One stage that is being looked at, and all that belongs to it; for one thread at a time.

`Session` hands it from task to task. Nothing outside of tasks touches the stage, but for a
simulation, which takes `lock` for as long as it reads or writes it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd, UsdGeom

from usdsplat.delegate.default_camera import Box
from usdsplat.delegate.engine import Engine
from usdsplat.kernels.device import CpuDevice
from usdsplat.preview import boxes
from usdsplat.preview.compiling import telling
from usdsplat.preview.display import Display
from usdsplat.preview.drawing import Drawing, Shown
from usdsplat.preview.scenes import Scenes
from usdsplat.preview.sources import Sources
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.values import Event, Opened, StageChanged, ViewState
from usdsplat.sim.stage.collections import find_simulations


class Document:
    """A stage and what is drawn of it.

    Args:
        stage: What is looked at. Edits go to its session layer.
        path: Where it came from; None for one that was handed over.
        device, threads: As `Engine` takes them.
        publish: Told what happens.
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
        """The files that it was read from; None for a stage that was handed over."""
        self.lock = threading.RLock()
        """Held by whoever reads or writes the stage."""
        self.publish = publish
        self.wake: Callable[[], None] = lambda: None
        """Tells the session that the stage may have changed; callable from any thread."""
        self.edits = Edits(stage)
        """What edits the session layer and takes that back."""
        self.simulation: Any = None
        """What runs the stage's simulations, a `Runner`; None where nobody simulates."""
        self.engine = Engine(stage, device=device, threads=threads)
        self._scenes = Scenes(
            self.engine,
            lambda time: Engine(stage, device=device, threads=threads, time=time),
            up_axis=_up_axis(stage),
        )
        self._thread = threading.get_ident()
        self._change: StageChanged | None = None
        self._notice = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._note_change, stage)
        display = Display(CpuDevice(threads=threads))  # what it shows is on the host already
        self._drawing = Drawing(self._scenes, display)

    @property
    def shown(self) -> Shown | None:
        """What the last picture was made of; None before the first."""
        return self._drawing.shown

    def opened(self) -> Opened:
        """What a window should know first."""
        stage = self.stage
        with self.lock, telling(self.publish):
            has_range = stage.HasAuthoredTimeCodeRange()
            return Opened(
                name=self.path.name if self.path else stage.GetRootLayer().GetDisplayName(),
                start=stage.GetStartTimeCode() if has_range else 0.0,
                end=stage.GetEndTimeCode() if has_range else 0.0,
                rate=stage.GetTimeCodesPerSecond(),
                up_axis=_up_axis(stage),
                cameras=tuple(self.engine.cameras()),
                has_simulation=bool(find_simulations(stage)),
            )

    def draw(self, state: ViewState) -> bool:
        """Draw and publish a picture, unless the last one was this; whether a better one follows.

        What has been edited on the stage since is told first, once.

        Raises:
            UsdSplatError: If the state asks for what cannot be drawn.
        """
        change, self._change = self._change, None
        if change is not None:
            if change.structure and self.simulation is not None:
                self.simulation.look()
            self.publish(change)
        with telling(self.publish):
            picture = self._drawing.draw(state, self.lock, self._outlines)
        if picture is None:
            return False
        self.publish(picture)
        return not (picture.is_final or state.is_moving)

    def still(self, state: ViewState) -> Shown:
        """Return the best picture of a state; nobody is shown it.

        Raises:
            UsdSplatError: If the state asks for what cannot be drawn.
        """
        still = replace(state, is_moving=False)
        with telling(self.publish):
            while (picture := self._drawing.draw(still, self.lock, self._outlines)) is not None:
                if picture.is_final:
                    break
        assert self.shown is not None
        self._drawing.forget()
        return self.shown

    def bounds(self, paths: tuple[str, ...] = ()) -> Box | None:
        """Where to look, in the world at the time that is shown; None if nothing is there.

        Args:
            paths: Of prims, which count with all that is beneath them; none for all that is seen.
        """
        with self.lock:
            if not paths:
                return self.engine.render_scene.subject()
            corners = [corner for path in paths for corner in self._outline(self.engine, path)]
        return boxes.around(corners)

    def frame_anew(self) -> None:
        """Let the camera that frames everything look where everything is now."""
        self._scenes.frame_anew()

    def close(self) -> None:
        """Let go of everything."""
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

    def _note_change(self, notice: Usd.Notice.ObjectsChanged, stage: Usd.Stage) -> None:
        """Remember it. A simulation writes in a thread of its own: its frames are no edits, and
        panels would do nothing else but ask again."""
        if threading.get_ident() != self._thread:
            return
        others = any(path.IsAbsoluteRootOrPrimPath() for path in notice.GetResyncedPaths())
        ranges = Sdf.Path.absoluteRootPath in notice.GetChangedInfoOnlyPaths()
        before = self._change is not None and self._change.structure
        self._change = StageChanged(structure=others or ranges or before)

    def _outlines(self, engine: Engine, paths: tuple[str, ...]) -> tuple[boxes.Corners, ...]:
        found = (self._outline(engine, path) for path in paths)
        return tuple(corners for corners in found if corners)

    def _outline(self, engine: Engine, path: str) -> boxes.Corners:
        """The box of a prim: of what is drawn of it, or else what USD says; () if there is none."""
        drawn = boxes.drawn(engine.render_scene, path)
        if drawn:
            return drawn
        prim = self.stage.GetPrimAtPath(path)
        if not prim or not prim.IsA(UsdGeom.Imageable):
            return ()
        code = Usd.TimeCode.Default() if engine.time is None else Usd.TimeCode(engine.time)
        tokens = UsdGeom.Imageable.GetOrderedPurposeTokens()
        cache = UsdGeom.BBoxCache(code, tokens, useExtentsHint=True, ignoreVisibility=True)
        bound = cache.ComputeWorldBound(prim)
        span = bound.GetRange()
        if span.IsEmpty():
            return ()
        points = (bound.GetMatrix().Transform(span.GetCorner(i)) for i in range(8))
        return tuple((point[0], point[1], point[2]) for point in points)


def _up_axis(stage: Usd.Stage) -> Any:
    """ "Y" or "Z"."""
    return str(UsdGeom.GetStageUpAxis(stage))
