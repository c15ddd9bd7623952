"""The main window: menus, keys, dropped files, and opening stages."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QAction, QCloseEvent, QDragEnterEvent, QDropEvent, QKeySequence
from PySide6.QtWidgets import QFileDialog, QLabel, QMainWindow, QStackedWidget

from usdsplat import formats
from usdsplat.core.axes import flipped
from usdsplat.interchange.files import SUFFIXES
from usdsplat.preview.opening import open_document
from usdsplat.preview.qt import remembered, style
from usdsplat.preview.qt.acts import acts_of
from usdsplat.preview.qt.camera_menu import CameraEntries
from usdsplat.preview.qt.empty_page import EmptyPage
from usdsplat.preview.qt.glyphs import glyph, window_icon
from usdsplat.preview.qt.help_dialog import HelpDialog, show_about
from usdsplat.preview.qt.keys import KEYS, MENUS, Key
from usdsplat.preview.qt.leaving import CLOSES, ask_to_leave, losses
from usdsplat.preview.qt.message_bar import MessageBar, above
from usdsplat.preview.qt.opening_again import Opener, Source
from usdsplat.preview.qt.recent_menu import RecentMenu
from usdsplat.preview.qt.save_dialogs import Saving
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.session import Session
from usdsplat.preview.values import Busy, Opened, Problem
from usdsplat.preview.viewer import Viewer

TOOLS = ("tool_none", "tool_translate", "tool_rotate", "tool_scale")
PURPOSES = ("render", "proxy", "guide")
ALWAYS = ("open", "new", "close", "quit", "help", "about")
"""Actions that need no stage."""
SAID_FOR = 6000
"""Duration of a message in the status bar [ms]."""


class Window(QMainWindow):
    """A main window with one stage at a time, in its own session.

    If a file cannot be opened, the current stage stays open.

    Args:
        device, threads: As for `Engine`, for files that are opened here.
    """

    new_requested = Signal(object)
    """Another window is requested, with a path or None."""
    opened = Signal(object)
    """A stage has been opened here."""
    closed = Signal()

    def __init__(self, *, device: str = "auto", threads: int | None = None) -> None:
        super().__init__()
        self._device = device
        self._threads = threads
        self._pending: SessionProxy | None = None
        self._remarks: tuple[str, ...] = ()
        """Remarks on the stage that is being opened."""
        self._source: Source | None = None
        """What is open here."""
        self._leaves = False
        """Whether the window closes without asking."""
        self.workspace: Workspace | None = None
        self.saving: Saving | None = None
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowIcon(window_icon())
        self.setStyleSheet(style.sheet())
        self.setAcceptDrops(True)
        remembered.place(self)
        self.problems = MessageBar(is_problem=True)
        self.empty = EmptyPage()
        self._pages = QStackedWidget()
        self._pages.addWidget(self.empty)
        self.setCentralWidget(above(self._pages, self.problems))
        self._note, self._path_note = QLabel(), QLabel()
        self._busy, self._warning = "", ""
        self._path_note.setContentsMargins(0, 0, 10, 0)
        self._note.setContentsMargins(6, 0, 0, 0)
        self._path_note.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.statusBar().addWidget(self._note, 1)
        self.statusBar().addPermanentWidget(self._path_note)
        self.statusBar().setSizeGripEnabled(False)
        self.actions_by_name: dict[str, QAction] = {}
        self._make_menus()
        self._show_title()
        self._enable()

    @property
    def note(self) -> str:
        """Message of the status bar."""
        return self._note.text()

    # --- opening ----------------------------------------------------------------------------

    def open(self, path: Path, *, axes: str | None = None) -> None:
        """Open a stage or a capture here, once it is read; ask first if work would be lost.

        Args:
            path: The file.
            axes: Axes of a capture; None for its own.
        """
        opener = partial(open_document, path, device=self._device, threads=self._threads)
        self._open(Source(opener=opener, path=path, axes=axes))

    def flip(self) -> None:
        """Open the capture again, turned upside down; a stage has its own axes and stays."""
        workspace, source = self.workspace, self._source
        if workspace is not None and source is not None and workspace.opened.axes:
            axes = flipped(workspace.opened.axes)
            self._open(replace(source, axes=axes, is_same_scene=False))

    def open_with(self, opener: Opener, *, path: Path | None = None) -> None:
        """Open a document by a function, which has a path if it is that of a file."""
        self._open(Source(opener=opener, path=path))

    def _open(self, source: Source) -> None:
        opens = f"you open {source.name or 'something else'}"
        self._unless_kept(partial(self._read, source), opens, is_same_scene=source.is_same_scene)

    def _unless_kept(
        self, leave: Callable[[], None], event: str, *, is_same_scene: bool = False
    ) -> None:
        """Call a function, after asking if something would be lost by it.

        Args:
            leave: The function.
            event: What it does, as part of a sentence.
            is_same_scene: Whether bookmarks are kept.
        """
        workspace, saving = self.workspace, self.saving
        is_lost = bool(losses(workspace, event, is_same_scene=is_same_scene))
        if workspace is not None and saving is not None and is_lost:
            ask_to_leave(self, workspace, saving, leave, event, is_same_scene=is_same_scene)
        else:
            leave()

    def _read(self, source: Source) -> None:
        """Open a document in its own session."""
        self._forget_pending()
        proxy = SessionProxy(Session(source.open), self)
        self._pending, self._remarks = proxy, ()
        proxy.opened.connect(partial(self._switch, proxy, source))
        proxy.problem.connect(partial(self._could_not_open, proxy))
        reading = f"Reading {source.name}…" if source.name else "Reading…"
        proxy.busy.connect(partial(self._show_busy, proxy, reading))
        self._say(reading)
        self.empty.say(reading)

    def _switch(self, proxy: SessionProxy, source: Source, opened: Opened) -> None:
        """Replace the old stage by the newly opened one."""
        if proxy is not self._pending:
            return
        self._pending, self._source = None, source
        self._device = source.device or self._device
        proxy.problem.disconnect()
        proxy.opened.disconnect()
        old = self.workspace
        kept = None if old is None else old.kept(is_same_scene=source.is_same_scene)
        workspace = Workspace(proxy, opened, device=self._device, kept=kept)
        self.workspace = workspace
        self.saving = Saving(workspace.context, said=self._say_briefly, window=self)
        workspace.device_chosen.connect(self._use_device)
        workspace.simulation.first.made.connect(self._open_made)
        workspace.simulation.recorded.connect(remembered.note_file)
        workspace.simulation.open_requested.connect(self._open_made)
        workspace.simulation.offers_bakes = True
        workspace.viewport.manipulator_changed.connect(self._follow)
        workspace.strip.show_tools([self.actions_by_name[name] for name in TOOLS])
        workspace.context.history_changed.connect(self._show_history)
        workspace.context.view_changed.connect(self._follow)
        workspace.context.said.connect(self._say_briefly)
        workspace.context.proxy.picture.connect(
            lambda picture: self._show_warnings(picture.warnings)
        )
        for name in ("step_on", "step_back", "to_start", "to_end"):
            workspace.viewport.addAction(self.actions_by_name[name])
            workspace.timeline.addAction(self.actions_by_name[name])
        if self._remarks:
            workspace.problems.say("\n".join(self._remarks))
        if opened.axes_are_assumed:
            words = f"The file does not say where its axes point; {opened.axes} is assumed."
            workspace.notices.say(words, action="Flip", act=self.flip)
        if source.path is not None:
            remembered.note_file(source.path)
        self._pages.addWidget(workspace)
        self._pages.setCurrentWidget(workspace)
        self.problems.clear()
        self._say("")
        self._show_title(opened.name)
        self._show_history(None, None)
        self._enable()
        self._follow()
        workspace.viewport.setFocus()
        if old is not None:
            self._pages.removeWidget(old)
            old.end()
            old.deleteLater()
        self.opened.emit(opened)

    def _could_not_open(self, proxy: SessionProxy, problem: Problem) -> None:
        if proxy is self._pending:
            self._remarks = (*self._remarks, problem.sentence)
            if proxy.session.has_failed:
                self._forget_pending()
                self._say("")
                self.empty.say("")
                self.problems.say("\n".join(self._remarks))

    def _forget_pending(self) -> None:
        if self._pending is not None:
            proxy, self._pending = self._pending, None
            proxy.close()
            threading.Thread(target=proxy.session.close, name="closes a session").start()
            proxy.deleteLater()

    def _use_device(self, device: str) -> None:
        """Open the document again on another device."""
        if self._source is not None:
            self._open(replace(self._source, device=device, is_same_scene=True))

    def _open_made(self, path: Path) -> None:
        """Open the stage of a preset or a bake, which has the scene of the open one."""
        opener = partial(open_document, path, device=self._device, threads=self._threads)
        self._open(Source(opener=opener, path=path, is_same_scene=True))

    # --- actions ---------------------------------------------------------------------------

    def ask_open(self) -> None:
        """Ask for a file to open."""
        dialog = QFileDialog(self, "Open")
        suffixes = (*SUFFIXES, *formats.suffixes_read())
        everything = " ".join(f"*{suffix}" for suffix in dict.fromkeys(suffixes))
        dialog.setNameFilters([f"Stages and captures ({everything})", "All files (*)"])
        dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.fileSelected.connect(lambda name: self.open(Path(name)))
        dialog.open()

    def show_help(self) -> None:
        """Show the help dialog."""
        HelpDialog(self).open()

    def about(self) -> None:
        """Show the about dialog."""
        show_about(self)

    # --- Qt's -------------------------------------------------------------------------------

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if any(url.isLocalFile() for url in event.mimeData().urls()):
            _take_a_copy(event)

    def dropEvent(self, event: QDropEvent) -> None:
        files = [url.toLocalFile() for url in event.mimeData().urls() if url.isLocalFile()]
        _take_a_copy(event)
        self.open(Path(files[0]))
        for each in files[1:]:
            self.new_requested.emit(Path(each))

    def leave(self) -> None:
        """Close the window without asking."""
        self._leaves = True
        self.close()

    def closeEvent(self, event: QCloseEvent) -> None:
        if not self._leaves and losses(self.workspace):
            event.ignore()
            self._unless_kept(self.leave, CLOSES)
            return
        remembered.keep_place(self)
        self._forget_pending()
        if self.workspace is not None:
            self.workspace.end()
        self.closed.emit()
        super().closeEvent(event)

    # --- private ----------------------------------------------------------------------------

    def _make_menus(self) -> None:
        acts = acts_of(self)
        menus = {name: self.menuBar().addMenu(name) for name in MENUS}
        for key in KEYS:
            menu = menus[key.menu]
            if key.begins:
                menu.addSeparator()
            action = self._make_action(key, acts[key.name])
            self.actions_by_name[key.name] = action
            menu.addAction(action)
        self._purposes = {}
        menus["View"].addSeparator()
        purposes = menus["View"].addMenu("Purposes")
        for purpose in PURPOSES:
            action = purposes.addAction(purpose)
            action.setCheckable(True)
            action.triggered.connect(partial(self._set_purpose, purpose))
            self._purposes[purpose] = action
        self._recent = RecentMenu(self, opens=self.open)
        menus["File"].insertMenu(self.actions_by_name["new"], self._recent)
        self._cameras = CameraEntries(menus["Camera"], viewer=self._viewer)

    def _make_action(self, key: Key, act: Callable[[], Any]) -> QAction:
        action = QAction(key.text, self)
        action.setShortcuts([QKeySequence(each) for each in key.keys])
        action.setCheckable(key.is_checkable)
        if key.place == "viewport":
            action.setShortcutContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
        action.triggered.connect(lambda is_on=False: act())
        if key.name in TOOLS:
            action.setIcon(glyph(key.name.removeprefix("tool_")))
        return action

    def _viewer(self) -> Viewer | None:
        return None if self.workspace is None else self.workspace.context.viewer

    def _set_purpose(self, purpose: str, is_on: bool) -> None:
        if self.workspace is not None:
            self.workspace.set_purposes(purpose, is_on)

    def _follow(self) -> None:
        if self.workspace is None:
            return
        state = self.workspace.context.viewer.state
        for name, is_on in self.workspace.toggles.items():
            self.actions_by_name[name].setChecked(is_on)
        for name in TOOLS:
            mode = self.workspace.viewport.mode or "none"
            self.actions_by_name[name].setChecked(name == f"tool_{mode}")
        for purpose, action in self._purposes.items():
            action.setChecked(purpose in state.purposes)
        self._path_note.setText(self.workspace.context.selected)
        self._enable_simulation()

    def _show_history(self, undoable: str | None, redoable: str | None) -> None:
        for name, word, step in (("undo", "Undo", undoable), ("redo", "Redo", redoable)):
            action = self.actions_by_name[name]
            action.setText(f"{word} {step}" if step else word)
            action.setEnabled(step is not None)

    def _enable(self) -> None:
        for name, action in self.actions_by_name.items():
            if name not in ("undo", "redo"):
                action.setEnabled(self.workspace is not None or name in ALWAYS)
        is_capture = self.workspace is not None and bool(self.workspace.opened.axes)
        self.actions_by_name["flip"].setEnabled(is_capture)
        self._enable_simulation()

    def _enable_simulation(self) -> None:
        workspace = self.workspace
        has_simulation = workspace is not None and workspace.context.viewer.has_simulation
        for name in ("sim_run", "sim_step", "sim_reset", "sim_record"):
            self.actions_by_name[name].setEnabled(has_simulation)

    def _show_busy(self, proxy: SessionProxy, reading: str, busy: Busy) -> None:
        """Show what a session does; between two tasks, as long as it opens, that it reads."""
        if not busy.what and proxy is self._pending:
            busy = Busy(what=reading)
        part = f" {100 * busy.done // busy.total} %" if busy.total else ""
        before, self._busy = self._busy, f"{busy.what}{part}"
        if self._busy or self._note.text() == before:  # what was said since stays
            self._say(self._busy)
        self.empty.show_busy(busy)

    def _say(self, words: str) -> None:
        self._note.setText(words)

    def _say_briefly(self, words: str) -> None:
        self._say(words)
        QTimer.singleShot(SAID_FOR, self, lambda: self._forget(words))

    def _forget(self, words: str) -> None:
        if self._note.text() == words:
            self._say("")

    def _show_warnings(self, warnings: tuple[str, ...]) -> None:
        self.statusBar().setToolTip("\n".join(warnings))
        before, self._warning = self._warning, warnings[0] if warnings else ""
        if self._note.text() in ("", before):  # a warning is no longer said once it is over
            self._say(self._warning)

    def _show_title(self, name: str = "") -> None:
        self.setWindowTitle(f"{name} — usdsplat" if name else "usdsplat")


def _take_a_copy(event: QDropEvent) -> None:
    """Accept a drop as a copy: where it is taken as a move, a file manager may delete the file."""
    event.setDropAction(Qt.DropAction.CopyAction)
    event.accept()
