"""Ask before a stage is left whose edits or recording would be lost."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QMessageBox, QWidget

from usdsplat.preview.qt.save_dialogs import Saving
from usdsplat.preview.qt.workspace import Workspace

RECORDS = (
    "Stop the recording before {event}? Its frames stay as a whole bake, and Record resumes it."
)
EDITED = "Save your edits to {name} before {event}? They go to a layer of their own."
MARKED = "Bookmarks are forgotten: {names}. Save those that matter as cameras first."
CLOSES = "the window closes"
"""What happens after the question, as the end of its sentence."""


def losses(
    workspace: Workspace | None, event: str = CLOSES, *, is_same_scene: bool = False
) -> tuple[str, ...]:
    """Return a sentence for everything that is lost or ends when a stage is left; the arguments
    are those of `ask_to_leave`."""
    if workspace is None:
        return ()
    edited = EDITED.format(name=workspace.opened.name, event=event)
    marks = () if is_same_scene else workspace.context.viewer.bookmarks
    asked = (
        RECORDS.format(event=event) if workspace.simulation.is_recording else "",
        edited if workspace.context.has_unsaved else "",
        MARKED.format(names=", ".join(mark.name for mark in marks)) if marks else "",
    )
    return tuple(filter(None, asked))


def ask_to_leave(
    window: QWidget,
    workspace: Workspace,
    saving: Saving,
    leave: Callable[[], None],
    event: str,
    *,
    is_same_scene: bool,
) -> QMessageBox:
    """Ask before something is lost. `leave` is called if the user goes on, after saving if asked.

    Args:
        window: Parent of the question.
        workspace, saving: What is left.
        leave: Leaves it.
        event: What happens then, as part of a sentence, such as "the window closes".
        is_same_scene: Whether the same scene is opened, which keeps the bookmarks.
    """
    words = "\n\n".join(losses(workspace, event, is_same_scene=is_same_scene))
    box = QMessageBox(QMessageBox.Icon.Warning, "usdsplat", words, parent=window)
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    if workspace.context.has_unsaved:
        save = box.addButton("Save as…", QMessageBox.ButtonRole.AcceptRole)
        save.clicked.connect(lambda: saving.session_layer(then=leave))
    ends = "Stop and leave" if workspace.simulation.is_recording else "Leave"
    text = "Leave without saving" if workspace.context.has_unsaved else ends
    go = box.addButton(text, QMessageBox.ButtonRole.DestructiveRole)
    go.clicked.connect(lambda: leave())
    stay = box.addButton("Stay", QMessageBox.ButtonRole.RejectRole)
    box.setDefaultButton(stay)
    box.setEscapeButton(stay)
    box.open()
    return box
