"""The widgets of an open stage: viewport, panels and timeline."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import (
    QApplication,
    QInputDialog,
    QMenu,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from usdsplat.preview import opening
from usdsplat.preview.display import choices
from usdsplat.preview.kept_view import KeptView
from usdsplat.preview.picking import Picked, pick
from usdsplat.preview.qt.adding_lights import LightHint
from usdsplat.preview.qt.message_bar import MessageBar, above
from usdsplat.preview.qt.panel_context import PanelContext, Question
from usdsplat.preview.qt.prim_panel import PrimPanel
from usdsplat.preview.qt.prim_tree import PrimTree
from usdsplat.preview.qt.probe_panel import ProbePanel
from usdsplat.preview.qt.render_panel import RenderPanel
from usdsplat.preview.qt.session_proxy import SessionProxy
from usdsplat.preview.qt.shadow_hint import ShadowHint
from usdsplat.preview.qt.simulation_panel import SimulationPanel
from usdsplat.preview.qt.timeline_bar import TimelineBar
from usdsplat.preview.qt.view_strip import ViewStrip
from usdsplat.preview.qt.viewport import Viewport
from usdsplat.preview.stage_model import cameras
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.unsimulated import unsimulated
from usdsplat.preview.values import Opened, Problem
from usdsplat.render.specs import CameraSpec

LOOK_AT_FILES = 2000
"""Interval of checks for changed files [ms]."""
SIDES = (330, 920, 350)
"""Initial widths of tree, viewport and panels [pixel]."""
NARROWEST = (260, 250, 316)
"""Minimum widths of tree, viewport and panels [pixel]."""


_OVERLAYS = {
    "bounds": "shows_bounds",
    "wireframe": "shows_edges",
    "lights": "shows_lights",
    "affectors": "shows_affectors",
}
"""Action -> field of the viewer's state."""


class Workspace(QWidget):
    """The content of a window with an open stage.

    Args:
        proxy: Proxy of the session, which ends with this widget.
        opened: Properties of the stage.
        device: Requested device of the session.
        kept: What the view keeps of the stage that was open before; None for a first one.
    """

    device_chosen = Signal(str)

    def __init__(
        self,
        proxy: SessionProxy,
        opened: Opened,
        *,
        device: str,
        kept: KeptView | None = None,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.opened = opened
        self.proxy = proxy
        proxy.setParent(self)
        self.context = context = PanelContext(proxy, self)
        context.baked = opened.baked
        self.bookmarks = QMenu("Bookmarks", self)
        self.bookmarks.aboutToShow.connect(self._fill_bookmarks)
        self.problems = MessageBar(is_problem=True)
        self._of_picture = ""
        self.notices = MessageBar(is_problem=False)
        self.strip = ViewStrip(context, bookmarks=self.bookmarks)
        self.viewport = Viewport(context.viewer)
        self.tree = PrimTree(context)
        self.prim = PrimPanel(context)
        self.render_panel = RenderPanel(context, device=device)
        LightHint(context, self.render_panel.lights, self.notices)
        ShadowHint(context, self.notices)
        self.simulation = SimulationPanel(context)
        self.probe = ProbePanel(context, self.viewport)
        self.timeline = TimelineBar(context)
        self._connect()
        self._lay_out()
        self._files = Question(self, self._ask_files)
        self._watch = QTimer(self)
        self._watch.timeout.connect(self._files.refresh)
        self._watch.start(LOOK_AT_FILES)
        context.viewer.set_overlays(shows_lights=True, shows_affectors=True)
        if kept is not None:
            kept.begin(context.viewer)
        context.viewer.opened(opened)
        if kept is not None:
            kept.finish(context.viewer)
        self.tree.model.refresh()

    def end(self) -> None:
        """Close the session without waiting for its current task."""
        self._watch.stop()
        self.proxy.close()
        threading.Thread(target=self.proxy.session.close, name="closes a session").start()

    def kept(self, *, is_same_scene: bool) -> KeptView:
        """Return what the view of the next stage keeps of this one."""
        viewer = self.context.viewer
        return KeptView(state=viewer.state, bookmarks=viewer.bookmarks, is_same_scene=is_same_scene)

    # --- actions ---------------------------------------------------------------------------

    def frame_selected(self) -> None:
        """Frame the selected prims, or everything."""
        self.context.viewer.frame(self.context.viewer.state.selected)

    def free_camera(self) -> None:
        """Switch to a free camera with the same view."""
        viewer = self.context.viewer
        viewer.use_camera(viewer.free_camera())

    def toggle_compare(self) -> None:
        """Switch the comparison on or off."""
        self.right.setCurrentWidget(self.render_panel)
        self.render_panel.set_compare(self.context.viewer.state.other is None)

    @property
    def shows_hud(self) -> bool:
        """Whether the heads-up display is visible."""
        return self.viewport.shows_hud

    def toggle_hud(self) -> None:
        """Show or hide the heads-up display."""
        self.viewport.set_hud(not self.viewport.shows_hud)

    @property
    def toggles(self) -> dict[str, bool]:
        """Whether what the menus switch on and off is on, by the name of its action."""
        state = self.context.viewer.state
        return {
            "compare": state.other is not None,
            "hud": self.shows_hud,
            "levels": self.context.look.aov == "splatId" and state.display.id_colors == "levels",
            **{name: getattr(state, field) for name, field in _OVERLAYS.items()},
        }

    def toggle_levels(self) -> None:
        """Colour splat trees by level, or show colour again; a message says if there are none."""
        context = self.context
        if self.toggles["levels"]:
            context.viewer.set_display(id_colors="ids")
            context.set_look(aov="color")
            return

        def found(has_trees: bool) -> None:
            if has_trees:
                context.viewer.set_display(id_colors="levels")
                context.set_look(aov="splatId")
            else:
                self.notices.say("No splat trees here")
                context.view_changed.emit()  # takes the tick off the menu

        self.proxy.ask(lambda document: document.has_trees, found)

    def toggle_overlay(self, name: str) -> None:
        """Show or hide bounds, wireframe, lights or affectors."""
        self.context.viewer.set_overlays(**{_OVERLAYS[name]: not self.toggles[name]})

    def toggle_channel(self, channel: str) -> None:
        """Show a single channel, or all again if it is already shown."""
        is_on = self.context.viewer.state.display.channel == channel
        self.context.viewer.set_display(channel="rgb" if is_on else channel)

    def expose(self, stops: float | None) -> None:
        """Change the display exposure; None resets it."""
        now = self.context.viewer.state.display.exposure
        exposure = 0.0 if stops is None else now + stops
        self.context.attempt(lambda: self.context.viewer.set_display(exposure=exposure))

    def next_aov(self, by: int) -> None:
        """Show the next AOV of the list."""
        names = [aov.name for aov in choices(self.context.viewer.lights)]
        shown = self.context.look.aov
        place = names.index(shown) if shown in names else 0
        self.context.set_look(aov=names[(place + by) % len(names)])

    def leave(self) -> None:
        """Go back to the viewport from anywhere else; there, clear the selection."""
        if self.viewport.hasFocus():
            self.context.viewer.select(())
        self.viewport.setFocus()

    def search(self) -> None:
        """Focus the search of properties if the focus is in their panel, else that of prims."""
        is_prim = self.prim.isAncestorOf(QApplication.focusWidget() or self)
        if is_prim:
            self.prim.search()
        else:
            self.tree.box.setFocus()

    def undo(self) -> None:
        """Undo the last edit."""
        self.context.edit(Edits.undo)

    def redo(self) -> None:
        """Redo the last undone edit."""
        self.context.edit(Edits.redo)

    def reload(self) -> None:
        """Reload files that have changed on disk."""
        self.notices.say("Reading again…")

        def done(names: tuple[str, ...]) -> None:
            self.problems.clear()
            self.notices.clear()
            self.tree.model.refresh()

        self.proxy.ask(opening.reload, done, lambda error: self._failed(str(error)))

    def save_camera(self) -> None:
        """Author the view as a camera on the session layer, and use it."""
        picture = self.context.picture
        if picture is None:
            return

        viewer, before = self.context.viewer, set(self.context.viewer.cameras)

        def made(paths: tuple[str, ...]) -> None:
            viewer.cameras = paths
            for path in set(paths) - before:
                viewer.use_camera(path)
                self.context.said.emit(f"Saved the camera {path}; the view looks through it")
            self.strip.follow()

        self.context.edit(partial(_save_camera, spec=picture.camera))
        self.proxy.ask(lambda document: cameras.cameras(document.stage), made)

    def add_bookmark(self) -> None:
        """Bookmark the view under a new name."""
        name = self.context.viewer.add_bookmark().name
        self.context.said.emit(f"{name} bookmarked; Bookmarks or Camera > {name} shows it again")

    def ask_new_name(self, name: str) -> None:
        """Ask for another name of a bookmark."""
        dialog = QInputDialog(self)
        dialog.setWindowTitle("Rename a bookmark")
        dialog.setLabelText("Name")
        dialog.setTextValue(name)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.textValueSelected.connect(partial(self.context.viewer.rename, name))
        dialog.open()

    def set_purposes(self, purpose: str, is_on: bool) -> None:
        """Set whether prims of a purpose are drawn."""
        viewer = self.context.viewer
        kept = tuple(each for each in viewer.state.purposes if each != purpose)
        viewer.set_purposes((*kept, purpose) if is_on else kept)

    # --- private ----------------------------------------------------------------------------

    def _connect(self) -> None:
        proxy, context = self.proxy, self.context
        proxy.picture.connect(self.viewport.show_picture)
        proxy.picture.connect(lambda picture: self._take_back())
        proxy.busy.connect(self.viewport.show_busy)
        proxy.problem.connect(self._say)
        context.settled.connect(self._settle)
        self.tree.frame_requested.connect(lambda path: context.viewer.frame((path,)))
        self.viewport.focus_requested.connect(self._aim)
        context.view_changed.connect(lambda: self.viewport.set_side(context.side))
        context.view_changed.connect(self._say_unsimulated)
        self.render_panel.device_chosen.connect(self.device_chosen)

    def _lay_out(self) -> None:
        self.left = QSplitter(Qt.Orientation.Vertical)
        self.left.addWidget(self.tree)
        self.left.addWidget(self.prim)
        self.left.setSizes([440, 320])
        self.center = QWidget()
        middle = QVBoxLayout(self.center)
        middle.setContentsMargins(0, 0, 0, 0)
        middle.setSpacing(0)
        middle.addWidget(self.strip)
        middle.addWidget(above(self.viewport, self.problems, self.notices), 1)
        self.right = QTabWidget()
        self.right.setDocumentMode(True)
        self.right.addTab(self.render_panel, "Render")
        self.right.addTab(self.simulation, "Simulation")
        self.right.addTab(self.probe, "Probe")
        if self.opened.has_simulation:
            self.right.setCurrentWidget(self.simulation)
        self.sides = QSplitter(Qt.Orientation.Horizontal)
        for side, narrowest in zip((self.left, self.center, self.right), NARROWEST, strict=True):
            side.setMinimumWidth(narrowest)
            self.sides.addWidget(side)
        self.sides.setStretchFactor(1, 1)
        self.sides.setSizes(list(SIDES))
        for splitter in (self.left, self.sides):
            splitter.setHandleWidth(3)
            splitter.setChildrenCollapsible(True)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.sides, 1)
        column.addWidget(self.timeline)

    def _fill_bookmarks(self) -> None:
        viewer = self.context.viewer
        self.bookmarks.clear()
        self.bookmarks.addAction("Bookmark this view", self.add_bookmark)
        self.bookmarks.addAction("Save view as a camera", self.save_camera)
        self.bookmarks.addSeparator()
        for bookmark in viewer.bookmarks:
            self.bookmarks.addAction(bookmark.name, partial(viewer.restore, bookmark.name))
        if viewer.bookmarks:
            rename = self.bookmarks.addMenu("Rename")
            for bookmark in viewer.bookmarks:
                rename.addAction(f"{bookmark.name}…", partial(self.ask_new_name, bookmark.name))
            forget = self.bookmarks.addMenu("Remove")
            for bookmark in viewer.bookmarks:
                forget.addAction(bookmark.name, partial(viewer.remove, bookmark.name))

    def _ask_files(self, done: Callable[[], None]) -> None:
        def answered(names: tuple[str, ...]) -> None:
            done()
            if names:
                words = f"Changed on disk: {', '.join(names)}"
                self.notices.say(words, action="Reload", act=self.reload)

        self.proxy.ask(opening.changed_files, answered, lambda error: done())

    def _aim(self, x: float, y: float) -> None:
        """Centre the camera on the point under the pointer."""

        def found(picked: Picked | None) -> None:
            if picked is not None:
                self.context.viewer.aim(picked.position)

        self.proxy.ask(lambda document: pick(document, x, y), found)

    def _say(self, problem: Problem) -> None:
        self.problems.say(problem.sentence)
        self._of_picture = problem.sentence if problem.of_picture else ""

    def _say_unsimulated(self) -> None:
        """Say it if the shown time is not simulated."""
        context = self.context
        words = unsimulated(
            context.simulation,
            context.time,
            first=context.viewer.timeline.start,
            is_baked=context.baked is not None,
        )
        if words != self.viewport.badges.unsimulated:
            self.viewport.badges.unsimulated = words
            self.viewport.update()

    def _settle(self, sentence: str) -> None:
        if self.problems.sentence == sentence:
            self.problems.clear()

    def _take_back(self) -> None:
        """Clear the problem of the previous picture."""
        if self._of_picture and self.problems.sentence == self._of_picture:
            self.problems.clear()
        self._of_picture = ""

    def _failed(self, sentence: str) -> None:
        self.notices.clear()
        self.problems.say(sentence)


def _save_camera(edits: Edits, *, spec: CameraSpec) -> None:
    cameras.save_camera(edits, spec)
