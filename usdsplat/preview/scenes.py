"""The engines behind a viewport, each at the time that is looked at, and the cameras that see them.

One engine follows the timeline. A comparison with another time, or another refinement of surfaces,
has one of its own, which is closed when the comparison ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from usdsplat.delegate.default_camera import Box, frame_subject
from usdsplat.delegate.engine import Engine
from usdsplat.preview.boxes import Reach
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.values import Look, ViewState
from usdsplat.render.specs import CameraSpec


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """One look at an engine that has been synced."""

    engine: Engine
    number: int
    """Of the engine: no two have the same, one after the other either."""
    look: Look
    time: float | None
    """[time code]"""
    camera: CameraSpec
    prims: tuple[str, ...]
    """Paths that primId counts."""
    splats: int
    """On the stage, instances counted each."""
    version: int
    """Of what is drawn."""

    @property
    def place(self) -> tuple[Any, ...]:
        """Equal while what is there, and what sees it, are the same."""
        return self.number, self.version, self.time, self.camera

    @property
    def subject(self) -> Box | None:
        """Where most of what is drawn lies in the world."""
        return self.engine.render_scene.subject()


class Scenes:
    """The engines of one viewport.

    Args:
        engine: Of the timeline's time; its owner closes it.
        open_engine: Makes one for another time of the same stage.
        up_axis: Of the stage.
    """

    def __init__(
        self,
        engine: Engine,
        open_engine: Callable[[float | None], Engine],
        *,
        up_axis: Literal["Y", "Z"],
    ) -> None:
        self._engine = engine
        self._open = open_engine
        self._other: Engine | None = None
        self._count = 0
        self._up_axis = up_axis
        self._reach: dict[Engine, Reach] = {}
        self._framed: tuple[tuple[Any, ...], CameraSpec] | None = None

    def close(self) -> None:
        """Close the engine of a comparison."""
        if self._other is not None:
            self._other.close()
            self._reach.pop(self._other, None)
            self._other = None

    def has(self, scene: Scene) -> bool:
        """Whether the engine of a scene is still open."""
        return scene.engine in (self._engine, self._other)

    def frame_anew(self) -> None:
        """Let the camera that frames everything look where everything is now."""
        self._framed = None

    def synced(self, state: ViewState) -> tuple[Scene, ...]:
        """Bring the engines to what a state looks at; return a scene, or both of a comparison.

        Raises:
            StageError: If there is no such camera, or it cannot be used.
            UsageError: If a setting is out of range.
        """
        if state.other is None:
            self.close()
            return (self._scene(state, state.look, self._engine),)
        if _kept(state, state.look) == _kept(state, state.other):
            other = self._engine  # the other one stays: a playhead only crosses its time
        else:
            if self._other is None:
                self._other = self._open(_time(state, state.other))
                self._count += 1
            other = self._other
        return (
            self._scene(state, state.look, self._engine),
            self._scene(state, state.other, other),
        )

    # --- private ---------------------------------------------------------------------------

    def _scene(self, state: ViewState, look: Look, engine: Engine) -> Scene:
        engine.set_time(_time(state, look))
        engine.set_purposes(state.purposes)
        engine.set_refinement(look.settings.refinement)
        scene = engine.render_scene
        layout = scene.draw_list()
        return Scene(
            engine=engine,
            number=0 if engine is self._engine else self._count,
            look=look,
            time=engine.time,
            camera=self._camera(state, engine),
            prims=layout.prims,
            splats=layout.total,
            version=engine.version,
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
        """One that frames what is there when it is first asked for, and then stands still."""
        scene = engine.render_scene
        key = scene.prims(), aspect
        if self._framed is None or self._framed[0] != key:
            camera = frame_subject(
                scene.subject(), reach.of(scene), up_axis=self._up_axis, aspect=aspect
            )
            self._framed = key, camera
        return self._framed[1]


def _time(state: ViewState, look: Look) -> float | None:
    return state.time if look.time is None else look.time


def _kept(state: ViewState, look: Look) -> tuple[float | None, int]:
    """What an engine has one of."""
    return _time(state, look), look.settings.refinement
