"""Tests of the side of a comparison that is changed, and of the window while light is computed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdLux
from PySide6.QtCore import QPoint, QSize
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QScrollArea

from tests.preview.fakes import picture_of
from tests.preview.qt import windows
from tests.preview.qt.bench import Bench
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, opened, press, settled
from usdsplat.preview import light_times
from usdsplat.preview.overlays import LightMark, Overlays
from usdsplat.preview.qt import viewport_hud as hud
from usdsplat.preview.qt.glyphs import glyph
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.values import Busy
from usdsplat.render.settings import RenderSettings

KEY = LightMark(path="/Key", shape="sphere", matrix=tuple(np.eye(4).ravel().tolist()))


def test_keys_tool_bar_and_panel_change_the_same_side(window: Window, workspace: Workspace) -> None:
    """Oracle: the looks, by hand: the key changes B while its tab is chosen, and A after that; the
    tool bar and the panel show what the key has changed."""
    viewer, panel = workspace.context.viewer, workspace.render_panel
    workspace.toggle_compare()
    before = viewer.state.look.aov
    press(window, "]")
    assert viewer.state.look.aov == before and viewer.state.other.aov != before
    assert workspace.strip.aov.currentText() == panel.aov.currentText() == viewer.state.other.aov
    assert workspace.strip.aov_label.text() == "B · AOV"
    panel.side.setCurrentIndex(0)
    assert workspace.strip.aov.currentText() == panel.aov.currentText() == before
    assert workspace.viewport.side == 0
    press(window, "]")
    assert viewer.state.look.aov == viewer.state.other.aov != before
    workspace.toggle_compare()
    assert workspace.strip.aov_label.text() == "AOV"


def test_the_tabs_of_a_comparison_stay_in_sight(workspace: Workspace) -> None:
    """Oracle: no scroll area is above them; and none of the panel is wider than its place."""
    panel = workspace.render_panel
    workspace.right.setCurrentWidget(panel)
    workspace.toggle_compare()
    (area,) = panel.findChildren(QScrollArea)
    assert not area.isAncestorOf(panel.side) and not area.isAncestorOf(panel.compare)
    assert not area.horizontalScrollBar().isVisible()
    wait_until(lambda: area.widget().width() <= area.viewport().width())
    workspace.toggle_compare()


def test_levels_without_trees_are_refused_with_a_word(window: Window, workspace: Workspace) -> None:
    """Oracle: the message; the looks and the tick of the menu stay as they were."""
    before = workspace.context.viewer.state
    press(window, "5")
    wait_until(lambda: workspace.notices.sentence == "No splat trees here")
    assert replace(workspace.context.viewer.state, size=before.size) == before
    assert not window.actions_by_name["levels"].isChecked()


def test_an_icon_keeps_its_colour_in_a_selected_row() -> None:
    """Oracle: the pixels of the icon: white, where Qt would mix in the colour of the selection."""
    for name, color in (("eye", ""), ("eye shut", "#686868")):
        image = glyph(name, color).pixmap(QSize(16, 16), QIcon.Mode.Selected).toImage()
        tints = {
            image.pixelColor(x, y).getRgb()[:3]
            for x in range(image.width())
            for y in range(image.height())
            if image.pixelColor(x, y).alpha() == 255
        }
        assert tints == {(255, 255, 255)}


def test_the_pane_of_numbers_keeps_its_lines_and_width(bench: Bench) -> None:
    """Oracle: the lines of pictures with other stages, and the rectangles that were painted."""
    state = bench.viewer.state
    one = picture_of(state, milliseconds={"project": 1.0, "blend": 2.0, "total": 3.5})
    other = replace(
        one, splats=1_204_331, milliseconds={"light splats": 12000.5, "walk": 9.0, "total": 12010.0}
    )
    rows = [hud.rows_of(each, rate=None) for each in (one, other)]
    assert [name for name, _ in rows[0]] == [name for name, _ in rows[1]]
    assert dict(rows[1])["  light"] == "12000.5" and dict(rows[1])["  blend"] == "9.0"
    image = bench.viewport.grab().toImage()
    from PySide6.QtCore import QPointF
    from PySide6.QtGui import QPainter

    painter = QPainter(image)
    panes = [hud.paint_rows(painter, each, QPointF(0.0, 0.0)) for each in rows]
    painter.end()
    assert panes[0] == panes[1]


def test_a_picture_without_its_light_is_not_full(bench: Bench) -> None:
    """Oracle: the row by hand; the badge's words, and its pixels at the top of the middle."""
    state = bench.viewer.state
    behind = picture_of(state, lacks_light=True, is_final=False)
    assert dict(hud.rows_of(behind, rate=None))["quality"] == "last light"
    bench.show()
    before = bench.viewport.grab().toImage()
    bench.viewport.show_picture(behind)
    bench.viewport.show_busy(Busy(what="lighting", done=12, total=128, of_picture=True))
    after = bench.viewport.grab().toImage()
    x = bench.viewport.width() // 2
    assert any(before.pixelColor(x + d, 18) != after.pixelColor(x + d, 18) for d in range(-40, 40))
    from usdsplat.preview.qt.viewport_painting import progress_of

    told = Busy(what="lighting", done=12, total=128, of_picture=True)
    assert progress_of(told) == "Lighting… 12/128"
    assert progress_of(Busy(what="reading", done=1, total=2)) == ""


def test_a_light_has_its_handles_before_the_next_picture(bench: Bench) -> None:
    """Oracle: the session, which answers nothing: the placement of the light is known at once, and
    a press on its arrow moves the light, and its figure with it, not the view."""
    picture = picture_of(bench.viewer.state, overlays=Overlays(lights=(KEY,)))
    bench.viewer.shown(picture)
    bench.viewport.show_picture(picture)
    bench.session.is_held_back = True
    bench.viewer.select(("/Key",))
    assert bench.viewport.manipulator is not None
    assert bench.viewport.projection is not None
    x, y = bench.viewport.projection.pixels(np.zeros((1, 3)))[0]
    arrow = QPoint(round(x) + 40, round(y))
    assert bench.viewport.targets.at((arrow.x(), arrow.y())).handle == "x"
    camera = bench.viewer.state.camera
    bench.drag(QPoint(30, 0), LEFT, at=arrow)
    assert bench.viewer.state.camera == camera
    (mark,) = bench.viewport.targets.lights
    assert mark.place[0] > 0.01
    placement = bench.viewer.placement
    assert placement is not None and mark.matrix == placement.matrix


@pytest.fixture
def lit(window: Window, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    """Two fields and a light that no movement waits for."""
    monkeypatch.setattr(light_times, "QUICK", -1.0)
    path = windows.write_stage(tmp_path / "lit.usda")
    stage = Usd.Stage.Open(str(path))
    light = UsdLux.SphereLight.Define(stage, "/Key")
    light.AddTranslateOp().Set(Gf.Vec3d(0.5, 2.0, 1.0))
    stage.Save()
    return opened(window, path)


def test_a_window_shows_the_old_light_until_the_new_one_is_there(lit: Workspace) -> None:
    """Oracle: the pictures that came to the window, in order."""
    came = []
    lit.proxy.picture.connect(came.append)
    lit.context.set_look(settings=RenderSettings(lighting="shadowed"))
    last = settled(lit)
    assert came[0].lacks_light and not came[0].is_final
    assert not last.lacks_light
