"""Panel of a simulation's controls and parameters, which act from its next frame on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QFileDialog,
    QGridLayout,
    QLabel,
    QListWidget,
    QMessageBox,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from usdsplat.core.errors import StageError
from usdsplat.core.output import Existing
from usdsplat.preview.document import Document
from usdsplat.preview.qt import style
from usdsplat.preview.qt.first_simulation import FirstSimulation
from usdsplat.preview.qt.glyphs import glyph
from usdsplat.preview.qt.knob_panel import KnobPanel
from usdsplat.preview.qt.panel_context import PanelContext, Question
from usdsplat.preview.qt.picture_dialogs import ask_name
from usdsplat.preview.qt.render_panel import scrolling
from usdsplat.preview.qt.save_dialogs import BAKES
from usdsplat.preview.qt.search_box import SearchBox
from usdsplat.preview.simulating.recording import can_resume
from usdsplat.preview.stage_model import parameters
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.parameters import ParameterPrim
from usdsplat.preview.values import SimulationStatus

_GOES = ("beginning", "running", "recording")
_WORDS = {
    "none": "No simulation on this stage",
    "ready": "Ready",
    "beginning": "Beginning…",
    "running": "Running",
    "paused": "Paused",
    "recording": "Recording",
    "failed": "Failed",
}


class SimulationPanel(QWidget):
    """Controls of the document's simulation; parameters are edited on the session layer."""

    recorded = Signal(object)
    """A bake became whole, a Path."""
    open_requested = Signal(object)
    """The user wants to see a bake, a Path."""

    def __init__(self, context: PanelContext, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._context = context
        self.status = SimulationStatus(state="none")
        self._prims: tuple[ParameterPrim, ...] = ()
        self._time: float | None = None
        """Time of the values that are shown or asked for."""
        self._question = Question(self, self._ask)
        self.run = _button("play", "Run", self.toggle)
        self.step = _button("step on", "Step", lambda: self._command("step"))
        self.reset = _button("reset", "Reset", lambda: self._command("reset"))
        self.record = _button("record", "Record", self.record_or_stop)
        self._is_stopping = False
        """Whether a recording was asked to stop, and finishes its bake."""
        self.offers_bakes = False
        """Whether someone opens bakes when `open_requested` is emitted."""
        self.open_bake = QPushButton("Open the bake")
        self.open_bake.clicked.connect(lambda: self.open_requested.emit(Path(self.status.bake)))
        self._state = QLabel()
        self._state.setProperty("role", "heading")
        self._facts = QLabel()
        self._facts.setFont(style.digits())
        self._facts.setProperty("role", "quiet")
        self._notes = QLabel()
        self._notes.setWordWrap(True)
        self._notes.setProperty("role", "quiet")
        self._message = QLabel()
        self._message.setWordWrap(True)
        self._message.setProperty("role", "animated")
        self.prims = QListWidget()
        self.prims.setFixedHeight(88)
        self.prims.currentRowChanged.connect(self._choose)
        self.panel = KnobPanel(open_groups=2)
        self.search = SearchBox("Search parameters")
        self.search.textChanged.connect(lambda text: self.panel.search(text))
        self.first = FirstSimulation(context)
        self.panel.changed.connect(self._set)
        self.panel.refused.connect(context.complain)
        self._lay_out()
        context.proxy.simulation.connect(self.show_status)
        context.proxy.stage_changed.connect(lambda event: self._question.refresh())
        context.view_changed.connect(self._follow)
        self.show_status(self.status)
        self._question.refresh()

    def show_status(self, status: SimulationStatus) -> None:
        """Show the status of the simulation."""
        before, self.status = self.status.bake, status
        has_one, goes = status.state != "none", status.state in _GOES
        records = self.is_recording
        self._is_stopping = self._is_stopping and records
        self.run.setText("Pause" if goes else "Continue" if records else "Run")
        self.run.setIcon(glyph("pause" if goes else "play"))
        for button in (self.run, self.reset):
            button.setEnabled(has_one and not self._is_stopping)
        self.step.setEnabled(has_one and not goes and not records)
        self._show_record(status)
        self.record.setEnabled(has_one and not self._is_stopping)
        self._state.setText(_state_text(status, self._context.baked))
        facts = []
        if status.frame is not None:
            end = "" if status.end is None else f" of {status.end:g}"
            facts.append(f"frame {status.frame:g}{end}")
        if status.splats:
            facts.append(f"{status.splats:,} splats")
        if status.seconds:
            facts.append(f"{status.seconds * 1000:.0f} ms/frame")
        self._facts.setText("   ".join(facts))
        self._notes.setText("\n".join(status.notes))
        self._notes.setVisible(bool(status.notes))
        told = _recorded_text(status) if status.bake else "" if records else status.message
        self._message.setText(told)
        self._message.setVisible(bool(told))
        self.open_bake.setVisible(self.offers_bakes and bool(status.bake))
        if status.bake and status.bake != before:
            self.recorded.emit(Path(status.bake))
        self._pages.setCurrentIndex(int(has_one))

    def toggle(self) -> None:
        """Run, or pause."""
        self._command("pause" if self.status.state in _GOES else "run")

    def one_step(self) -> None:
        """Simulate one frame."""
        self._command("step")

    def to_start(self) -> None:
        """Reset the simulation."""
        self._command("reset")

    def ask_record(self) -> None:
        """Ask for a file, and record to it."""
        dialog = ask_name(self, "Record to a bake", BAKES, "bake.usda", self.record_to)
        dialog.setOption(QFileDialog.Option.DontConfirmOverwrite)

    def record_or_stop(self) -> None:
        """Ask for a file and record; or stop the recording."""
        if not self.is_recording:
            self.ask_record()
            return
        self._is_stopping = True
        self._command("stop")
        self.show_status(self.status)

    @property
    def is_recording(self) -> bool:
        """Whether a bake is recorded, held or not."""
        return self.status.recorded is not None and not self.status.bake

    def record_to(self, path: Path) -> None:
        """Simulate to the end and write a bake; ask first about an existing file."""
        if not path.exists():
            self._record(path, existing="replace")
            return
        self._context.proxy.ask(
            lambda document: can_resume(path), partial(self._ask_what_becomes_of, path)
        )

    # --- private ----------------------------------------------------------------------------

    def _show_record(self, status: SimulationStatus) -> None:
        """Show the button that records as one that stops, while it records."""
        words, tip, icon = "Record", "Simulate to the end and write a bake", "record"
        if self.is_recording and status.recorded is not None:
            done, total = status.recorded
            words = f"Stop ({done} of {total})" if total else "Stop"
            tip, icon = "End the recording; the bake has the frames so far", "stop"
        self.record.setText("Finishing…" if self._is_stopping else words)
        self.record.setToolTip(tip)
        self.record.setIcon(glyph(icon, style.WRONG.name()))

    def _ask_what_becomes_of(self, path: Path, goes_on: bool) -> None:
        words = "is a recording that was stopped" if goes_on else "exists"
        box = QMessageBox(QMessageBox.Icon.Question, "Record", f"{path.name} {words}.", parent=self)
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        cancel = box.addButton(QMessageBox.StandardButton.Cancel)
        replace = box.addButton("Replace", QMessageBox.ButtonRole.DestructiveRole)
        replace.clicked.connect(lambda: self._record(path, existing="replace"))
        box.setDefaultButton(cancel)
        if goes_on:
            resume = box.addButton("Resume", QMessageBox.ButtonRole.AcceptRole)
            resume.clicked.connect(lambda: self._record(path, existing="resume"))
            box.setDefaultButton(resume)
        box.open()

    def _record(self, path: Path, *, existing: Existing) -> None:
        self._context.proxy.ask(partial(_record, path=path, existing=existing))

    def _lay_out(self) -> None:
        head = QWidget()
        rows = QVBoxLayout(head)
        rows.setContentsMargins(8, 8, 8, 4)
        rows.setSpacing(5)
        buttons = QGridLayout()
        buttons.setSpacing(4)
        for place, button in enumerate((self.run, self.step, self.reset)):
            buttons.addWidget(button, 0, place)
            buttons.setColumnStretch(place, 1)
        buttons.addWidget(self.record, 1, 0, 1, 3)
        rows.addLayout(buttons)
        rows.addWidget(self._state)
        rows.addWidget(self._facts)
        rows.addWidget(self._notes)
        rows.addWidget(self._message)
        rows.addWidget(self.open_bake)
        rows.addWidget(self.prims)
        rows.addWidget(self.search)
        body = QWidget()
        lines = QVBoxLayout(body)
        lines.setContentsMargins(0, 0, 0, 6)
        lines.addWidget(self.panel)
        lines.addStretch(1)
        controls = QWidget()
        column = QVBoxLayout(controls)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(head)
        column.addWidget(scrolling(body), 1)
        self._pages = QStackedWidget()
        self._pages.addWidget(self.first)
        self._pages.addWidget(controls)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self._pages)

    def _command(self, name: str) -> None:
        self._context.proxy.ask(partial(_do, name=name))

    def _ask(self, done: Callable[[], None]) -> None:
        def answered(prims: tuple[ParameterPrim, ...]) -> None:
            done()
            self._show_prims(prims)
            self._follow_time()

        self._time = time = self._context.time
        self._context.proxy.ask(
            lambda document: parameters.editors(document.stage, time=time),
            answered,
            lambda error: answered(()),
        )

    def _show_prims(self, prims: tuple[ParameterPrim, ...]) -> None:
        paths = [prim.path for prim in prims]
        if paths != [prim.path for prim in self._prims]:
            self.prims.blockSignals(True)
            chosen = max(self.prims.currentRow(), 0)
            self.prims.clear()
            for prim in prims:
                self.prims.addItem(f"{prim.path.rsplit('/', 1)[-1]}   {prim.type_name}")
                self.prims.item(self.prims.count() - 1).setToolTip(prim.path)
            self.prims.setCurrentRow(min(chosen, len(prims) - 1))
            self.prims.blockSignals(False)
        self._prims = prims
        self._show_chosen()

    def _show_chosen(self) -> None:
        prim = self._chosen()
        self.panel.show_editors(prim.editors if prim else ())
        self.panel.search(self.search.text())

    def _chosen(self) -> ParameterPrim | None:
        row = self.prims.currentRow()
        return self._prims[row] if 0 <= row < len(self._prims) else None

    def _follow_time(self) -> None:
        """Ask for the values of another time, if any parameter has others."""
        is_animated = any(each.is_animated for prim in self._prims for each in prim.editors)
        if is_animated and self._context.time != self._time:
            self._time = self._context.time
            self._question.refresh()

    def _choose(self, row: int) -> None:
        """Show a prim's parameters and select it."""
        prim = self._chosen()
        self._show_chosen()
        if prim is not None and prim.path != self._context.selected:
            self._context.viewer.select((prim.path,))

    def _follow(self) -> None:
        """Show the values at the time, and the parameters of a prim that was selected elsewhere."""
        self._follow_time()
        paths = [prim.path for prim in self._prims]
        if self._context.selected in paths:
            self.prims.setCurrentRow(paths.index(self._context.selected))

    def _set(self, name: str, value: Any, merge: str) -> None:
        prim = self._chosen()
        if prim is not None:
            now = self._context.time
            step = partial(
                _set, path=prim.path, name=name, value=value, now=now, merge=merge or None
            )
            drag = f"{prim.path} {name} {merge}" if merge else ""
            self._context.edit(step, failed=lambda: self._question.refresh(at_once=True), drag=drag)
            self._question.refresh()


def _button(icon: str, words: str, act: Callable[[], Any]) -> QPushButton:
    button = QPushButton(glyph(icon), words)
    button.clicked.connect(lambda: act())
    return button


def _state_text(status: SimulationStatus, baked: tuple[float, float] | None) -> str:
    """Return the heading of a state."""
    if status.state == "paused" and status.recorded is not None and not status.bake:
        return "Recording, paused"
    if status.state == "ready" and baked is not None:
        return f"Baked, frames {baked[0]:g}–{baked[1]:g}"
    return _WORDS[status.state]


def _recorded_text(status: SimulationStatus) -> str:
    """Return a sentence about a bake that is whole."""
    done, total = status.recorded or (0, 0)
    name = Path(status.bake).name
    if done == total:
        return f"{done} frames recorded: {name}."
    return f"{done} of {total} frames recorded: {name}. Record to it again to add the others."


def _simulation(document: Document) -> Any:
    if document.simulation is None:
        raise StageError("simulation", "no SplatSim prim", "a stage with one")
    return document.simulation


def _do(document: Document, *, name: str) -> None:
    simulation = _simulation(document)
    {
        "run": simulation.run,
        "pause": simulation.pause,
        "step": simulation.step,
        "reset": simulation.reset,
        "stop": simulation.stop,
    }[name]()


def _record(document: Document, *, path: Path, existing: Existing) -> None:
    _simulation(document).record(path, existing=existing)


def _set(
    edits: Edits, *, path: str, name: str, value: Any, now: float | None, merge: str | None
) -> None:
    parameters.edit_parameter(edits, path, name, value, now=now, merge=merge)
