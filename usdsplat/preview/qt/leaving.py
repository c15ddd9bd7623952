"""Ask before a stage is left whose edits or recording would be lost."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QMessageBox, QWidget

from usdsplat.preview.qt.save_dialogs import Saving
from usdsplat.preview.qt.workspace import Workspace

RECORDS = "A recording is not finished. Its frames stay as a whole bake, and Record can resume it."
EDITED = "The edits of {name} are on its session layer, which is not saved."


def losses(workspace: Workspace | None) -> tuple[str, ...]:
    """Return a sentence for everything that is lost or ends when a stage is left."""
    if workspace is None:
        return ()
    is_recording = workspace.simulation.is_recording
    edited = EDITED.format(name=workspace.opened.name) if workspace.context.has_unsaved else ""
    return tuple(filter(None, (RECORDS if is_recording else "", edited)))


def ask_to_leave(
    window: QWidget, workspace: Workspace, saving: Saving, leave: Callable[[], None]
) -> QMessageBox:
    """Show what would be lost. `leave` is called if the user goes on, after saving if asked."""
    words = "\n\n".join(losses(workspace))
    box = QMessageBox(QMessageBox.Icon.Warning, "usdsplat", words, parent=window)
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    if workspace.context.has_unsaved:
        save = box.addButton("Save as…", QMessageBox.ButtonRole.AcceptRole)
        save.clicked.connect(lambda: saving.session_layer(then=leave))
    text = "Leave without saving" if workspace.context.has_unsaved else "Stop and leave"
    go = box.addButton(text, QMessageBox.ButtonRole.DestructiveRole)
    go.clicked.connect(lambda: leave())
    stay = box.addButton("Stay", QMessageBox.ButtonRole.RejectRole)
    box.setDefaultButton(stay)
    box.setEscapeButton(stay)
    box.open()
    return box
