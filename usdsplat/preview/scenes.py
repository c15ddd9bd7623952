"""The engines of a viewport, each at its time, and the cameras of its views.

One engine follows the timeline. A comparison with another time or refinement level has a second
engine, which is closed when the comparison ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

from usdsplat.delegate.default_camera import frame_subject
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.preview.boxes import Reach
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.values import Look, ViewState
from usdsplat.render.fields import Box
from usdsplat.render.lod.cache import NodeCache
from usdsplat.render.lod.nodes import view_cut
from usdsplat.render.specs import CameraSpec, Framing, View


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """A look with its synced engine."""

    engine: Engine
    number: int
    """Unique number of the engine, never reused."""
    look: Look
    time: float | None
    """Time code."""
    camera: CameraSpec
    prims: tuple[str, ...]
    """Paths of the prims by primId."""
    splats: int
    """Splats of a picture without a budget, counting every instance."""
    version: int
    """Version of the render scene."""
    nodes: NodeCache
    """Splats of splat trees in memory."""
    has_trees: bool = False
    """Whether there are splat trees."""

    @property
    def samples(self) -> int:
        """Number of samples of a picture in full quality."""
        settings = self.look.settings
        return max(settings.samples, settings.lod_samples**2 if self.has_trees else 1)

    @property
    def place(self) -> tuple[Any, ...]:
        """Key that is equal while scene and camera are unchanged."""
        return self.number, self.version, self.time, self.camera

    @property
    def subject(self) -> Box | None:
        """Box of most of the scene in the world."""
        return self.engine.render_scene.subject()


class LiveFrames(Protocol):
    """Frames of a running simulation that are drawn without being on the stage."""

    def shown_at(self, time: float | None) -> LiveClouds | None:
        """Return what to draw in place of the stage at a time; None if the stage has it."""

    def author(self) -> None:
        """Author all frames on the stage."""


class Scenes:
    """The engines of one viewport.

    Args:
        engine: Engine of the timeline's time; its owner closes it.
        open_engine: Function that opens an engine for another time of the same stage.
        up_axis: Up axis of the stage.
        on_read: Called by other threads after splats of splat trees were read.
        live: Returns the frames of the stage's simulation, if there is one.
    """

    def __init__(
        self,
        engine: Engine,
        open_engine: Callable[[float | None], Engine],
        *,
        up_axis: Literal["Y", "Z"],
        on_read: Callable[[], None],
        live: Callable[[], LiveFrames | None] = lambda: None,
    ) -> None:
        self._engine = engine
        self._open = open_engine
        self._other: Engine | None = None
        self._count = 0
        self._up_axis = up_axis
        self._on_read = on_read
        self._live = live
        self._reach: dict[Engine, Reach] = {}
        self._framed: tuple[tuple[Any, ...], CameraSpec] | None = None

    def close(self) -> None:
        """Close the engine of a comparison."""
        if self._other is not None:
            self._other.close()
            self._reach.pop(self._other, None)
            self._other = None

    def has(self, scene: Scene) -> bool:
        """Return whether the engine of a scene is still open."""
        return scene.engine in (self._engine, self._other)

    def frame_anew(self) -> None:
        """Let the default camera frame the current scene again."""
        self._framed = None

    def synced(self, state: ViewState) -> tuple[Scene, ...]:
        """Sync the engines to a state; return its scene, or both scenes of a comparison.

        Raises:
            StageError: If there is no such camera, or it is not usable.
            UsageError: If a setting is out of range.
        """
        if state.other is None:
            self.close()
            return (self._scene(state, state.look, self._engine),)
        if _kept(state, state.look) == _kept(state, state.other):
            other = self._engine  # keep the second engine: the playhead only passes its time
        else:
            if self._other is None:
                self._other = self._open(_time(state, state.other))
                self._count += 1
            other = self._other
        return (
            self._scene(state, state.look, self._engine),
            self._scene(state, state.other, other),
        )

    def author(self) -> None:
        """Author frames that were only drawn so far, for a picture that reads the stage."""
        live = self._live()
        if live is not None:
            live.author()

    # --- private ---------------------------------------------------------------------------

    def _scene(self, state: ViewState, look: Look, engine: Engine) -> Scene:
        engine.set_time(_time(state, look))
        live = self._live()
        engine.show_live(None if live is None else live.shown_at(engine.time))
        engine.set_purposes(state.purposes)
        engine.set_refinement(look.settings.refinement)
        scene = engine.render_scene
        scene.node_cache.on_read = self._on_read
        layout, camera = scene.draw_list(), self._camera(state, engine)
        splats = layout.total
        if scene.has_trees:
            view = View(camera=camera, framing=Framing(resolution=state.size))
            unlimited = replace(look.settings, splat_budget=0)
            splats = min(splats, layout.splats + view_cut(scene, view, unlimited).splats)
        return Scene(
            engine=engine,
            number=0 if engine is self._engine else self._count,
            look=look,
            time=engine.time,
            camera=camera,
            prims=layout.prims,
            splats=splats,
            version=engine.version,
            nodes=scene.node_cache,
            has_trees=scene.has_trees,
        )

    def _camera(self, state: ViewState, engine: Engine) -> CameraSpec:
        aspect = state.size[0] / max(1, state.size[1])
        if isinstance(state.camera, str):
            return engine.view(state.camera).camera
        reach = self._reach.setdefault(engine, Reach())
        if isinstance(state.camera, FreeCamera):
            return state.camera.spec(aspect=aspect, bounds=reach.of(engine.render_scene))
        return self._framing(engine, reach, aspect)

    def _framing(self, engine: Engine, reach: Reach, aspect: float) -> CameraSpec:
        """Return a camera that frames the scene at the first call, and then stays constant."""
        scene = engine.render_scene
        key = scene.prims(), aspect
        if self._framed is None or self._framed[0] != key:
            camera = frame_subject(
                scene.seen(), reach.of(scene), up_axis=self._up_axis, aspect=aspect
            )
            self._framed = key, camera
        return self._framed[1]


def _time(state: ViewState, look: Look) -> float | None:
    return state.time if look.time is None else look.time


def _kept(state: ViewState, look: Look) -> tuple[float | None, int]:
    """Return the properties that distinguish engines."""
    return _time(state, look), look.settings.refinement
