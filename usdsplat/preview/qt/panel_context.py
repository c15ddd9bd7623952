"""Shared state of the panels of a session: proxy, viewer and edits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from PySide6.QtCore import QEvent, QObject, QTimer, Signal
from PySide6.QtWidgets import QWidget

from usdsplat.core.errors import UsdSplatError
from usdsplat.preview.document import Document
from usdsplat.preview.latest_request import LatestRequest
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.values import Look, Picture, Problem, SimulationStatus, StageChanged
from usdsplat.preview.viewer import Viewer

GLIDE = 0.25
"""Duration of a camera move when something is framed [s]."""
PAUSE = 80
"""Least time between two queries of a panel [ms]: a simulation changes the stage each frame."""


class PanelContext(QObject):
    """The context of all panels of one session.

    Args:
        proxy: Proxy of the session; the caller closes it.
        parent: Qt parent.
    """

    view_changed = Signal()
    """The viewer's state, timeline, bookmarks or selection has changed."""
    settled = Signal(str)
    """A problem, by its sentence, is over."""
    said = Signal(str)
    """Something was done, in a sentence."""
    history_changed = Signal(object, object)
    """Labels of the next undo and redo; text or None."""

    def __init__(self, proxy: SessionProxy, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.proxy = proxy
        self.viewer = Viewer(proxy, changed=self.view_changed.emit, glide=GLIDE)
        self.picture: Picture | None = None
        """The last picture."""
        self.simulation = SimulationStatus(state="none")
        """The last status of the simulation."""
        self.baked: tuple[float, float] | None = None
        """First and last frame of the stage's bake [time code]; None without a bake."""
        self.has_unsaved = False
        """Whether the session layer has edits that are not saved, as far as is known."""
        self.side = 0
        """Side of a comparison that panels, keys and the tool bar change: 0 is A, 1 is B."""
        self._drags: dict[str, LatestRequest] = {}
        """Requests of drags in progress, by name."""
        self._history = Question(self, self._ask_history)
        proxy.picture.connect(self._keep)
        proxy.simulation.connect(self._simulated)
        proxy.stage_changed.connect(self._stage_changed)

    @property
    def time(self) -> float | None:
        """Time code of the viewport."""
        return self.viewer.state.time

    @property
    def look(self) -> Look:
        """The look that panels, keys and the tool bar show and change."""
        state = self.viewer.state
        return state.other if self.side and state.other else state.look

    def set_look(self, **changes: Any) -> None:
        """Change fields of that look."""
        if self.look is self.viewer.state.other:
            self.viewer.set_other(replace(self.look, **changes))
        else:
            self.viewer.set_look(**changes)

    def set_side(self, side: int) -> None:
        """Choose the side of a comparison that is changed."""
        if side != self.side:
            self.side = side
            self.view_changed.emit()

    @property
    def selected(self) -> str:
        """Path of the selected prim; "" for none."""
        chosen = self.viewer.state.selected
        return chosen[-1] if chosen else ""

    def edit(
        self,
        step: Callable[[Edits], object],
        *,
        failed: Callable[[], None] = lambda: None,
        drag: str = "",
    ) -> None:
        """Run an edit on the stage; an error becomes a problem message.

        Args:
            step: Function of the document's edits, called in the session's thread.
            failed: Called after an error, for example to show the old value again.
            drag: Name of a drag; of its waiting steps only the last one is run. "" for a single
                step.
        """

        def task(document: Document) -> tuple[str | None, str | None, bool]:
            step(document.edits)
            return _history_of(document)

        def refused(error: UsdSplatError) -> None:
            self.proxy.complain(error)
            failed()

        self.proxy.interrupt()
        self._drags = {name: each for name, each in self._drags.items() if each.is_busy}
        asks = self._drags.setdefault(drag, LatestRequest(self.proxy)) if drag else self.proxy
        asks.ask(task, self._show_history, refused)

    @property
    def is_dragging(self) -> bool:
        """Whether a step of a drag is in progress, and a later one may wait for it."""
        return any(each.is_busy for each in self._drags.values())

    def refresh_history(self) -> None:
        """Ask again for the labels of undo and redo, and whether there are unsaved edits."""
        self._history.refresh(at_once=True)

    def attempt(self, act: Callable[[], object]) -> None:
        """Run an action on the viewer; an error becomes a problem message."""
        try:
            act()
        except UsdSplatError as error:
            self.complain(str(error))

    def complain(self, sentence: str) -> None:
        """Show an error message like the session's own problems."""
        self.proxy.problem.emit(Problem(sentence=sentence))

    def _stage_changed(self, event: StageChanged) -> None:
        self._history.refresh()
        self.viewer.stage_changed(event)

    def _simulated(self, status: SimulationStatus) -> None:
        self.simulation = status
        self.viewer.simulated(status)

    def _keep(self, picture: Picture) -> None:
        self.picture = picture
        self.viewer.shown(picture)

    def _ask_history(self, done: Callable[[], None]) -> None:
        def answered(history: tuple[str | None, str | None, bool]) -> None:
            done()
            self._show_history(history)

        self.proxy.ask(_history_of, answered, lambda error: done())

    def _show_history(self, history: tuple[str | None, str | None, bool]) -> None:
        undoable, redoable, self.has_unsaved = history
        self.history_changed.emit(undoable, redoable)


def _history_of(document: Document) -> tuple[str | None, str | None, bool]:
    """Return the labels of the next undo and redo, and whether there are unsaved edits."""
    edits = document.edits
    return edits.undoable, edits.redoable, edits.has_unsaved


class Question(QObject):
    """A repeated query of a panel: one at a time, rate-limited, only while visible.

    Args:
        owner: Owner of the query; an invisible widget queries when it becomes visible.
        ask: Function that queries, and calls its argument after the answer or an error.
        pause: Minimum time between two queries [ms].
    """

    def __init__(
        self, owner: QObject, ask: Callable[[Callable[[], None]], None], *, pause: int = PAUSE
    ) -> None:
        super().__init__(owner)
        self._owner = owner
        self._ask = ask
        self._pause = pause
        self._is_asking = False
        self._is_wanted = False
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._go)
        if isinstance(owner, QWidget):
            owner.installEventFilter(self)

    def refresh(self, *, at_once: bool = False) -> None:
        """Query soon, with the state at that time."""
        self._is_wanted = True
        if not self._is_asking and (at_once or not self._timer.isActive()):
            self._timer.start(0 if at_once else self._pause)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show and self._is_wanted:
            self.refresh(at_once=True)
        return False

    def _go(self) -> None:
        if isinstance(self._owner, QWidget) and not self._owner.isVisible():
            return
        self._is_asking, self._is_wanted = True, False
        self._ask(self._answered)

    def _answered(self) -> None:
        self._is_asking = False
        if self._is_wanted:
            self.refresh()
