"""Where the selected prim is, and moving it: one question and one answer at a time.

A drag tells of more places than a stage can be at; those that were never authored when the next
one came are forgotten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from usdsplat.core.errors import UsdSplatError
from usdsplat.delegate.specs import Matrix
from usdsplat.preview.stage_model.placing import transform
from usdsplat.preview.values import Problem, ViewState


class Asks(Protocol):
    """A session, or a bridge to one that calls `done` in the thread that asked."""

    def look(self, state: ViewState, /) -> None:
        """Say what shall be seen."""

    def ask(self, task: Callable[[Any], Any], done: Callable[[Any], None], /) -> None:
        """Have something done with the document."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where a prim is."""

    path: str
    matrix: Matrix
    """Local to world, 16 numbers, row-major, for column vectors."""


class Newest:
    """Asks one thing at a time; of those that wait meanwhile the last one wins."""

    def __init__(self, session: Asks) -> None:
        self._session = session
        self._is_asking = False
        self._next: tuple[Callable[[Any], Any], Callable[[Any], None]] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether an answer is to come."""
        return self._is_asking

    def ask(self, task: Callable[[Any], Any], done: Callable[[Any], None]) -> None:
        """Have it done, now or after what is being done. The task must not raise."""
        if self._is_asking:
            self._next = task, done
            return

        def answered(result: Any) -> None:
            self._is_asking = False
            waiting, self._next = self._next, None
            if waiting is not None:
                self.ask(*waiting)
            done(result)

        self._is_asking = True
        self._session.ask(task, answered)


class Placing:
    """The placement of what is selected last.

    Args:
        session: Who has the stage.
        changed: Called when another placement is known.
    """

    def __init__(self, session: Asks, *, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._questions, self._moves = Newest(session), Newest(session)
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

        def task(document: Any) -> None:
            try:
                document.edits.set_transform(path, matrix, time=time, merge=key)
            except UsdSplatError as error:
                document.publish(Problem(sentence=str(error)))

        self._moves.ask(task, lambda done: None)
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
