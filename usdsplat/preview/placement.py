"""Where the selected prim is, and moving it: one question and one answer at a time.

A drag tells of more places than a stage can be at; those that were never authored when the next
one came are forgotten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from usdsplat.preview.latest_request import Asks, LatestRequest
from usdsplat.preview.stage_model.placing import transform
from usdsplat.render.specs import Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where a prim is."""

    path: str
    matrix: Matrix
    """Local to world, 16 numbers, row-major, for column vectors."""


class Placing:
    """The placement of what is selected last.

    Args:
        session: Who has the stage.
        changed: Called when another placement is known.
    """

    def __init__(self, session: Asks, *, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._questions, self._moves = LatestRequest(session), LatestRequest(session)
        self._path = ""
        self._drags = 0
        self.placement: Placement | None = None
        """None where nothing that has a place is selected, and until it is known."""

    def follow(self, path: str, time: float | None) -> None:
        """Know where a prim is at a time; "" for none."""
        if path != self._path:
            self._path, self.placement = path, None
        if path:
            self._questions.ask(lambda document: _placement(document, path, time), self._keep)

    def begin(self) -> None:
        """What is moved from now on is one step of undo."""
        self._drags += 1

    def move(self, matrix: Matrix, time: float | None) -> None:
        """Put the prim somewhere, at a time."""
        path, key = self._path, f"drag {self._drags} of {self._path}"
        if not path:
            return
        self.placement = Placement(path=path, matrix=matrix)

        self._moves.ask(
            lambda document: document.edits.set_transform(path, matrix, time=time, merge=key),
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
    """Where a prim is; None for one that cannot be moved."""
    prim = document.stage.GetPrimAtPath(path)
    if not prim or prim.IsInstanceProxy() or not prim.HasAttribute("xformOpOrder"):
        return None
    return Placement(path=path, matrix=transform(document.stage, path, time=time))
