"""Tests of the view strip with little space, and of messages that become obsolete."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import opened, settled
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace


@pytest.fixture
def workspace(application: QApplication, tmp_path: Path) -> Iterator[Workspace]:
    window = windows.show(Window())
    yield opened(window, windows.write_stage(tmp_path / "two.usda"))
    window.leave()


@pytest.mark.parametrize("width", [250, 300, 380, 480, 900])
def test_nothing_in_the_strip_lies_on_anything_else(workspace: Workspace, width: int) -> None:
    """Oracle: the rectangles that Qt gives its widgets; with room for all, all are there."""
    strip = workspace.strip
    strip.setParent(None)
    strip.setMinimumWidth(1)  # as in the window, whose panels have minimum widths of their own
    strip.resize(width, 30)
    strip.show()
    QApplication.processEvents()
    shown = [each for each in strip.children() if each.isWidgetType() and each.isVisible()]
    assert strip.width() == width
    boxes = sorted((each.geometry() for each in shown), key=lambda box: box.left())
    assert all(left.right() < right.left() for left, right in pairwise(boxes))
    assert boxes[-1].right() < strip.width()
    assert strip.camera.isVisible() and strip.aov.isVisible() == (width >= 380)
    assert strip.exposure.isVisible() == (width == 900)


def test_a_picture_takes_back_what_was_wrong_with_the_one_before(workspace: Workspace) -> None:
    """Oracle: a person's expectation: a config that is not there, and then none."""
    viewer = workspace.context.viewer
    settings = viewer.state.look.settings
    wrong = replace(settings, ocio_config="nowhere.ocio", color_mode="scene")
    viewer.set_look(settings=wrong)
    wait_until(lambda: "nowhere.ocio" in workspace.problems.sentence)
    viewer.set_look(settings=settings)
    settled(workspace)
    wait_until(lambda: not workspace.problems.sentence)


def test_a_picture_does_not_take_back_what_else_went_wrong(workspace: Workspace) -> None:
    """Oracle: a person's expectation: an edit that cannot be, and then another exposure."""
    workspace.context.complain("radius: found none, expected one")
    workspace.context.viewer.set_display(exposure=1.0)
    settled(workspace)
    assert workspace.problems.sentence == "radius: found none, expected one"


def test_messages_cover_nothing(workspace: Workspace) -> None:
    """Oracle: the rectangles that Qt gives the bars and the viewport, with both messages and with
    none; the picture fits the room that is left."""
    whole = workspace.viewport.height()
    workspace.context.complain("radius: found none, expected one")
    workspace.notices.say("Changed on disk: a.usda", action="Reload")
    QApplication.processEvents()
    bars = (workspace.problems, workspace.notices)
    tops = [each.mapTo(workspace, each.rect().bottomLeft()).y() for each in bars]
    top = workspace.viewport.mapTo(workspace, workspace.viewport.rect().topLeft()).y()
    assert all(each.isVisible() for each in bars) and max(tops) < top
    assert settled(workspace).state.size[1] < whole * workspace.devicePixelRatioF()
    for each in bars:
        each.clear()
    wait_until(lambda: workspace.viewport.height() == whole)
