"""Track and move the selected prim, one request at a time.

A drag gives more positions than the stage can process; those that are not authored when the next
one arrives are dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from usdsplat.preview.latest_request import Asks, LatestRequest
from usdsplat.preview.overlays import LightMark
from usdsplat.preview.stage_model.placing import can_move, transform
from usdsplat.render.specs import Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """The placement of a prim."""

    path: str
    matrix: Matrix
    """Local to world, 16 numbers, row-major, for column vectors."""


class Placing:
    """Tracker of the placement of the last selected prim.

    Args:
        session: Session of the stage.
        changed: Called when the placement changes.
    """

    def __init__(self, session: Asks, *, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._questions, self._moves = LatestRequest(session), LatestRequest(session)
        self._path = ""
        self._drags = 0
        self._verb = "Move"
        self._known: dict[str, Matrix] = {}
        self.placement: Placement | None = None
        """None if nothing movable is selected, and until it is known."""

    def note(self, lights: Iterable[LightMark]) -> None:
        """Note where the lights of a picture are: the placement of one is known once selected."""
        self._known = {mark.path: mark.matrix for mark in lights}

    def follow(self, path: str, time: float | None) -> None:
        """Track a prim at a time; "" for none."""
        if path != self._path:
            known = self._known.get(path)
            self._path = path
            self.placement = None if known is None else Placement(path=path, matrix=known)
        if path:
            self._questions.ask(lambda document: _placement(document, path, time), self._keep)

    def begin(self, verb: str) -> None:
        """Begin a new undo step for the following moves, named by a verb."""
        self._verb = verb
        self._drags += 1

    def move(self, matrix: Matrix | None, time: float | None) -> None:
        """Author the prim's matrix at a time; None takes all moves since `begin` back."""
        path, verb, key = self._path, self._verb, f"drag {self._drags} of {self._path}"
        if not path:
            return
        if matrix is None:
            self._moves.ask(
                lambda document: document.edits.take_back(key),
                lambda done: self.follow(path, time) if path == self._path else None,
            )
            return
        self.placement = Placement(path=path, matrix=matrix)
        if path in self._known:
            self._known[path] = matrix

        self._moves.ask(
            lambda document: document.edits.set_transform(
                path, matrix, time=time, merge=key, verb=verb
            ),
            lambda done: None,
        )
        self._changed()

    def _keep(self, found: Placement | None) -> None:
        if self._moves.is_busy or (found is not None and found.path != self._path):
            return
        if found != self.placement:
            self.placement = found
            self._changed()


def _placement(document: Any, path: str, time: float | None) -> Placement | None:
    """Return the placement of a prim; None if it cannot be moved."""
    if not can_move(document.stage.GetPrimAtPath(path)):
        return None
    return Placement(path=path, matrix=transform(document.stage, path, time=time))
