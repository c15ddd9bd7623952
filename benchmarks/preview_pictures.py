"""Make the pictures of the preview: `docs/view_window.png`, `view_web.png` and `view_usdview.png`.

    PXR_PLUGINPATH_NAME=$(usdsplat plugin-path) python -m benchmarks.preview_pictures [NAME ...]

A pattern grows on a capture of the test data while they are taken. The docks are shown in the
tests' replacement for usdview, without usdview's own widgets. The page needs Chromium. On an X
server with a window manager, such as Xvfb with openbox and QT_QPA_PLATFORM=xcb, the window is as
users see it.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Usd
from PySide6.QtCore import QEventLoop, QTimer
from PySide6.QtGui import QImage, QPixmap
from PySide6.QtWidgets import QApplication, QDockWidget

from benchmarks.scenes import DATA
from benchmarks.simulations import run, save
from tests.chromium import ARGUMENTS, NAMES
from tests.preview.usdview import usdviewq
from usdsplat.preview.opening import open_document
from usdsplat.preview.qt import style
from usdsplat.preview.qt.simulation_panel import SimulationPanel
from usdsplat.preview.qt.viewport import Viewport
from usdsplat.preview.qt.window import Window
from usdsplat.preview.session import Session
from usdsplat.preview.web.server import serve
from usdsplat.sim.stage.authoring import author

CAPTURE = DATA / "splats" / "statue_angel.sog"
SETTINGS = {"rd:substeps": 80, "rd:frontSpeed": 200.0}
SIZE = (1440, 900)
SIM = "/statue_angel/Simulation/Sim"
"""Path of the simulation, which is selected."""
FRAME = 10
"""Simulated frame to wait for."""
ORBIT, NEARER = (0.12, 0.02), 1.15
PATIENCE = 600.0  # s


def scene(folder: Path) -> Path:
    """Write a stage on which new matter grows quickly."""
    path = folder / "grow.usda"
    run(f"simulate --preset grow {CAPTURE} -o {path}")
    stage = Usd.Stage.Open(str(path))
    author(stage.GetPrimAtPath(SIM), SETTINGS)
    stage.Save()
    return path


def wait(condition: Callable[[], object]) -> None:
    """Process events until a condition holds."""
    deadline = time.monotonic() + PATIENCE
    loop = QEventLoop()
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit(f"found nothing in {PATIENCE:g} s, expected a picture")
        QTimer.singleShot(10, loop.quit)
        loop.exec()


def grown(viewport: Viewport, simulation: SimulationPanel) -> None:
    """Run the simulation to its frame, and see all of it from the side."""
    viewer = viewport.viewer
    wait(lambda: viewport.picture is not None)
    simulation.toggle()
    wait(lambda: (simulation.status.frame or 0) >= FRAME)
    simulation.toggle()
    wait(lambda: simulation.status.state == "paused")
    viewer.orbit(*ORBIT)
    viewer.dolly(NEARER)
    viewer.end_move()
    viewer.select((SIM,))
    wait(lambda: not viewer.is_ticking)
    wait(lambda: viewport.picture.is_final and viewport.picture.state == viewer.state)


def window(path: Path) -> np.ndarray:
    """Return a picture of the window."""
    shown = Window()
    shown.resize(*SIZE)
    shown.show()
    shown.open(path)
    wait(lambda: shown.workspace is not None)
    workspace = shown.workspace
    assert workspace is not None
    grown(workspace.viewport, workspace.simulation)
    image = pixels(shown.grab())
    shown.close()
    return image


def usdview(path: Path) -> np.ndarray:
    """Return a picture of the docks side by side, on a stage of the replacement for usdview."""
    usdviewq.install()
    host = usdviewq.Usdview(Usd.Stage.Open(str(path)))
    host.window.resize(*SIZE)
    host.window.show()
    host.load_plugins()
    menu = host.menus()["usdsplat"]
    for name in ("Splat Viewport", "Probe", "Render Settings", "Simulation"):
        menu[name].trigger()
    docks = {dock.windowTitle(): dock for dock in host.window.findChildren(QDockWidget)}
    wait(lambda: docks["Splat Viewport"].findChild(Viewport) is not None)
    panel = docks["Splat Simulation"].widget()
    grown(docks["Splat Viewport"].findChild(Viewport), panel)
    image = pixels(host.window.grab())
    for dock in docks.values():
        dock.close()
    return image


def web(path: Path) -> np.ndarray:
    """Return a picture of the page in Chromium."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, NAMES)))
    session = Session(lambda publish: open_document(path, publish=publish))
    server = serve(session)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=list(ARGUMENTS))
        page = chromium.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        page.set_default_timeout(1000 * PATIENCE)
        page.goto(server.url)
        page.click("#simulation-run")
        while float(page.input_value("#current") or 0) < FRAME:
            page.wait_for_timeout(200)
        page.click("#simulation-pause")
        box = page.locator("#picture").bounding_box()
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(*middle)
        page.mouse.down()
        page.mouse.move(middle[0] + ORBIT[0] * box["height"], middle[1] + ORBIT[1] * box["height"])
        page.mouse.up()
        page.mouse.wheel(0, 100)
        page.wait_for_timeout(3000)  # until the last movement has begun to be drawn
        page.locator("#speed", has_text="full").wait_for()
        shot = page.screenshot()
        chromium.close()
    server.close()
    session.close()
    found = QPixmap()
    found.loadFromData(shot)
    return pixels(found)


def pixels(shot: QPixmap) -> np.ndarray:
    """Return RGB [0..1], shape (h, w, 3)."""
    image = shot.toImage().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), -1)
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3) / 255.0


PICTURES = {"window": window, "web": web, "usdview": usdview}


def main(names: list[str]) -> None:
    """Make the pictures of these names, or all."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    application = QApplication([])
    style.dress(application)
    with tempfile.TemporaryDirectory() as folder:
        path = scene(Path(folder))
        for name in names or PICTURES:
            save(PICTURES[name](path), Path("docs") / f"view_{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
