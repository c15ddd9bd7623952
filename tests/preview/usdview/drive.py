"""Open our docks in the replacement for usdview, drive them as a user would, and record the
results.

    python -m tests.preview.usdview.drive FOLDER      # facts.json, and pictures

This runs in a separate process, because USD's registries keep the replacement for usdview.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom
from PySide6.QtCore import QEventLoop, QPoint, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDockWidget, QLabel

from tests.delegate.stages import add_camera, two_fields
from tests.preview.usdview import usdviewq
from tests.sim.stage.scenes import save_shot

PATIENCE = 240.0
"""Seconds for kernels to be compiled in."""


def pump(condition, seconds=PATIENCE):
    """Let events happen until something is so; returns whether it ever is."""
    deadline = time.monotonic() + seconds
    loop = QEventLoop()
    while not condition() and time.monotonic() < deadline:
        QTimer.singleShot(10, loop.quit)
        loop.exec()
    return bool(condition())


class Person:
    """Somebody at a usdview, and what they see.

    Args:
        stage: That usdview was started with.
        folder: Where what they see is kept.
    """

    def __init__(self, stage, folder):
        self.usdview = usdviewq.Usdview(stage)
        self.folder = folder
        self.window = self.usdview.window
        self.window.resize(1280, 720)
        self.window.setCentralWidget(QLabel("usdview"))
        self.window.show()
        self.usdview.load_plugins()
        self.menu = self.usdview.menus()["usdsplat"]
        self.model = self.usdview.model

    @property
    def docks(self):
        return {dock.windowTitle(): dock for dock in self.window.findChildren(QDockWidget)}

    @property
    def viewport(self):
        from usdsplat.preview.qt.viewport import Viewport

        return self.docks["Splat Viewport"].findChild(Viewport)

    @property
    def picture(self):
        return None if self.viewport is None else self.viewport.picture

    def sees(self, condition=lambda picture: True):
        """Wait for a full picture that is so; returns whether it comes."""
        return pump(
            lambda: self.picture is not None and self.picture.is_final and condition(self.picture)
        )

    def keep(self, name):
        self.window.grab().save(str(self.folder / f"{name}.png"))


def look(person, facts):
    """The viewport opens, and follows what usdview shows."""
    facts["menu"] = {text: action.toolTip() for text, action in person.menu.items()}
    facts["loaded at start"] = "usdsplat.preview.usdview.host" in sys.modules
    person.menu["Splat Viewport"].trigger()
    facts["first picture"] = person.sees(lambda picture: np.ptp(picture.image) > 60)
    person.menu["Splat Viewport"].trigger()
    facts["docks after opening twice"] = sorted(person.docks)
    person.model.currentFrame = Usd.TimeCode(3)
    facts["follows the frame"] = person.sees(lambda picture: picture.state.time == 3.0)
    person.model.selection.setPrim(person.model.stage.GetPrimAtPath("/World/B"))
    facts["follows the selection"] = person.sees(
        lambda picture: picture.state.selected == ("/World/B",)
    )
    person.model.viewSettings.cameraPrim = person.model.stage.GetPrimAtPath("/Camera")
    person.menu["Follow usdview's Camera"].trigger()
    facts["follows the camera"] = person.sees(lambda picture: picture.state.camera == "/Camera")
    person.keep("look")


def edit(person, facts):
    """What usdview does to its stage shows; what is picked in ours is selected in usdview."""
    before = person.picture.image
    UsdGeom.Imageable(person.model.stage.GetPrimAtPath("/World/B")).MakeInvisible()
    person.model.signalPrimsChanged.emit(None, None)
    facts["edits show"] = person.sees(lambda picture: not np.array_equal(picture.image, before))
    viewport = person.viewport
    bright = person.picture.image.astype(int).max(axis=-1)
    row, column = np.unravel_index(int(bright.argmax()), bright.shape)
    QTest.mouseClick(viewport, Qt.MouseButton.LeftButton, pos=QPoint(int(column), int(row)))
    selection = person.model.selection
    pump(lambda: [str(path) for path in selection.getPrimPaths()] == ["/World/A"], 60)
    facts["picked"] = [str(path) for path in selection.getPrimPaths()]
    taken = []
    action = person.window.menuBar().addAction("Frame Selected", lambda: taken.append("usdview"))
    action.setShortcut("F")
    viewport.setFocus()
    before = person.viewport.viewer.state.camera
    QTest.keyClick(viewport, Qt.Key.Key_F)
    facts["F frames in ours"] = pump(lambda: viewport.viewer.state.camera != before, 60)
    facts["F went to usdview"] = taken


def simulate(person, facts, stage):
    """Another stage, with a simulation that runs while usdview looks on."""
    gone = person.viewport
    person.menu["Follow usdview's Camera"].trigger()
    person.model.stage = None
    facts["empty without a stage"] = pump(lambda: person.viewport is None, 60)
    person.model.stage = stage
    facts["the next stage"] = person.sees()
    facts["another viewport"] = person.viewport is not gone
    for name in ("Simulation", "Render Settings", "Probe"):
        person.menu[name].trigger()
    panel = person.docks["Splat Simulation"].widget()
    facts["docks"] = sorted(person.docks)
    person.docks["Splat Simulation"].raise_()
    QTest.mouseClick(panel.run, Qt.MouseButton.LeftButton)
    facts["it runs"] = person.sees(lambda picture: (picture.state.time or 0.0) >= 4.0)
    facts["state"] = panel.status.state
    facts["root layer is dirty"] = stage.GetRootLayer().dirty
    person.keep("simulation")


def close(person, facts, stage):
    """Docks that are closed let go of everything; usdview may be closed with them open."""
    for dock in person.docks.values():
        dock.close()
    facts["nothing after closing"] = pump(lambda: person.viewport is None, 60)
    person.menu["Splat Viewport"].trigger()
    facts["opened again"] = person.sees()
    person.window.close()
    person.model.stage = None
    facts["sublayers left"] = list(stage.GetSessionLayer().subLayerPaths)
    facts["status"] = person.usdview.status


def refuse(facts):
    """A usdview with another Qt than ours."""

    usdview = usdviewq.Usdview(two_fields())
    usdview.load_plugins()
    usdview.window = type("Window", (), {"__module__": "PySide2.QtWidgets"})()
    usdview.containers[0]._commands[0].run()
    facts["with PySide2"] = usdview.status


def main(folder: Path) -> None:
    usdviewq.install()
    application = QApplication([])
    stage = two_fields()
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(5)
    add_camera(stage, eye=(1.0, 0.0, 9.0))
    simulated = Usd.Stage.Open(str(save_shot(folder, {"particles:enabled": True}, count=200)))
    simulated.SetStartTimeCode(1)
    simulated.SetEndTimeCode(30)
    simulated.Save()
    facts: dict[str, object] = {}
    person = Person(stage, folder)
    look(person, facts)
    edit(person, facts)
    simulate(person, facts, simulated)
    close(person, facts, simulated)
    refuse(facts)
    (folder / "facts.json").write_text(json.dumps(facts))
    application.quit()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
