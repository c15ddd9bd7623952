"""Tests of panels built from editors, with mouse and key events."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QCheckBox, QComboBox, QLineEdit, QSlider

from tests.preview.qt.conftest import wait_until
from usdsplat.preview.knob_model import Editor
from usdsplat.preview.qt.knob_panel import KnobPanel, KnobRow, tool_tip

LEFT = Qt.MouseButton.LeftButton
EXPOSURE = Editor(
    name="exposure",
    label="Exposure",
    kind="float",
    value=0.5,
    default=0.0,
    minimum=-16.0,
    maximum=16.0,
    soft_range=(-8.0, 8.0),
    step=0.1,
    unit="stop",
    help="of the picture",
    group="Display",
)


class Panel(KnobPanel):
    """One that remembers what it was told."""

    def __init__(self, *editors: Editor, open_groups: int | None = None) -> None:
        super().__init__(open_groups=open_groups)
        self.changes: list[tuple[str, Any, str]] = []
        self.sentences: list[str] = []
        self.changed.connect(lambda *change: self.changes.append(change))
        self.refused.connect(self.sentences.append)
        self.show_editors(editors)
        self.resize(400, 300)
        self.show()
        self.activateWindow()
        wait_until(self.isActiveWindow)


@pytest.fixture(autouse=True)
def _(application: QApplication) -> None:
    """All of this needs an application."""


def _type(field: QLineEdit, text: str) -> None:
    QTest.mouseClick(field, LEFT)
    field.selectAll()
    QTest.keyClicks(field, text)
    QTest.keyClick(field, Qt.Key.Key_Return)


def test_a_number_is_typed_with_its_unit_out_of_the_way() -> None:
    """Oracle: a person's expectation."""
    panel = Panel(EXPOSURE)
    field = panel.row("exposure").findChild(QLineEdit)
    assert field.text() == "0.5 stop"
    _type(field, "-1.25")
    assert panel.changes == [("exposure", -1.25, "")]
    assert not panel.sentences


def test_what_is_no_number_is_refused_in_a_sentence_and_the_old_one_stays() -> None:
    """Oracle: the sentence that house rules ask for."""
    panel = Panel(EXPOSURE)
    field = panel.row("exposure").findChild(QLineEdit)
    _type(field, "bright")
    assert panel.sentences == ["Exposure: found 'bright', expected a number"]
    assert field.text() == "0.5"
    assert not panel.changes


def test_arrows_step_a_number_and_with_shift_ten_times_as_far() -> None:
    """Oracle: 0.5 + 0.1 and 0.5 - 10 · 0.1."""
    panel = Panel(EXPOSURE)
    field = panel.row("exposure").findChild(QLineEdit)
    QTest.mouseClick(field, LEFT)
    QTest.keyClick(field, Qt.Key.Key_Up)
    QTest.keyClick(field, Qt.Key.Key_Down, Qt.KeyboardModifier.ShiftModifier)
    assert [value for _, value, _ in panel.changes] == [0.6, -0.5]


def test_one_drag_of_a_slider_has_one_key_and_the_next_another() -> None:
    """Oracle: a drag is one step to undo, two drags are two."""
    panel = Panel(EXPOSURE)
    slider = panel.row("exposure").findChild(QSlider)
    keys = []
    for _ in range(2):
        panel.changes.clear()
        panel.show_editors([EXPOSURE])
        handle = QPoint(round(slider.width() * (0.5 + 8) / 16), slider.height() // 2)
        QTest.mousePress(slider, LEFT, pos=handle)
        for step in (5, 12, 20):
            QTest.mouseMove(slider, handle + QPoint(step, 0))
        QTest.mouseRelease(slider, LEFT, pos=handle + QPoint(20, 0))
        values = [value for _, value, _ in panel.changes]
        assert len(values) >= 2
        assert values == sorted(values)
        assert values[0] > 0.5
        keys.append({key for _, _, key in panel.changes})
    assert len(keys[0]) == len(keys[1]) == 1
    assert keys[0] != keys[1]
    assert "" not in keys[0] | keys[1]


def test_reset_goes_back_to_the_default_and_is_there_only_where_needed() -> None:
    """Oracle: a person's expectation."""
    panel = Panel(EXPOSURE)
    row = panel.row("exposure")
    assert row.reset.isVisible()
    QTest.mouseClick(row.reset, LEFT)
    assert panel.changes == [("exposure", 0.0, "")]
    panel.show_editors([_with(EXPOSURE, value=0.0)])
    assert not row.reset.isVisible()


@pytest.mark.parametrize(
    ("kind", "value", "act", "expected"),
    [
        ("bool", False, lambda row: QTest.mouseClick(row.findChild(QCheckBox), LEFT), True),
        ("text", "", lambda row: _type(row.findChild(QLineEdit), "ocio://x"), "ocio://x"),
        ("vector", (1.0, 2.0), lambda row: _type(row.findChildren(QLineEdit)[1], "5"), (1.0, 5.0)),
        (
            "color",
            (0.1, 0.2, 0.3),
            lambda row: _type(row.findChildren(QLineEdit)[0], "1"),
            (1.0, 0.2, 0.3),
        ),
        (
            "choice",
            "auto",
            lambda row: QTest.keyClick(row.findChild(QComboBox), Qt.Key.Key_Down),
            "zDepth",
        ),
    ],
)
def test_each_kind_has_a_widget(kind: Any, value: Any, act: Any, expected: Any) -> None:
    """Oracle: what was ticked, typed or chosen."""
    choices = ("auto", "zDepth") if kind == "choice" else ()
    editor = Editor(
        name="x", label="X", kind=kind, value=value, default=value, choices=choices, help="x"
    )
    panel = Panel(editor)
    act(panel.row("x"))
    assert panel.changes == [("x", expected, "")]


def test_an_empty_field_is_none_where_none_means_something() -> None:
    """Oracle: a person's expectation of "unlimited"."""
    panel = Panel(_with(EXPOSURE, none_label="unlimited"))
    field = panel.row("exposure").findChild(QLineEdit)
    QTest.mouseClick(field, LEFT)
    field.selectAll()
    QTest.keyClick(field, Qt.Key.Key_Delete)
    QTest.keyClick(field, Qt.Key.Key_Return)
    assert panel.changes == [("exposure", None, "")]


def test_what_is_being_typed_survives_news() -> None:
    """Oracle: a person's expectation, while a simulation changes other values."""
    panel = Panel(EXPOSURE)
    field = panel.row("exposure").findChild(QLineEdit)
    QTest.mouseClick(field, LEFT)
    field.selectAll()
    QTest.keyClicks(field, "3")
    panel.show_editors([_with(EXPOSURE, value=0.75)])
    assert field.text() == "3"
    QTest.keyClick(field, Qt.Key.Key_Return)
    assert panel.changes == [("exposure", 3.0, "")]


def test_rows_of_closed_groups_are_not_made_until_they_are_looked_for() -> None:
    """Oracle: the rows there are, counted."""
    editors = [_with(EXPOSURE, name=f"knob{i}", group=f"Group {i // 10}") for i in range(100)]
    panel = Panel(*editors, open_groups=1)
    assert len(panel.findChildren(QSlider)) == 10
    assert panel.search("KNOB42") == 1
    shown = [slider for slider in panel.findChildren(QSlider) if slider.isVisible()]
    assert len(shown) == 1
    assert panel.search("") == 100


def test_a_tool_tip_says_what_a_value_is() -> None:
    """Oracle: the editor's own words."""
    words = tool_tip(_with(EXPOSURE, is_animated=True))
    for word in ("Exposure", "of the picture", "stop", "-16 to 16", "default 0", "animated"):
        assert word in words


def _with(editor: Editor, **changes: Any) -> Editor:
    return replace(editor, **changes)


def test_what_few_people_turn_is_behind_more() -> None:
    """Oracle: the rows that are visible: main ones, all after a click, and what a search finds; an
    editor that becomes main, as it is authored, is shown in its place."""
    rest = replace(EXPOSURE, name="gamma", label="Gamma", is_main=False)
    last = replace(EXPOSURE, name="gain", label="Gain")
    panel = Panel(EXPOSURE, rest, last)
    group = panel._groups["Display"]

    def shown() -> list[str]:
        rows = [row for row in panel.findChildren(KnobRow) if row.isVisible()]
        return [row._editor.name for row in sorted(rows, key=lambda row: row.y())]

    assert shown() == ["exposure", "gain"] and group.more.text() == "More (1)"
    QTest.mouseClick(group.more, LEFT)
    wait_until(lambda: shown() == ["exposure", "gamma", "gain"])
    assert group.more.text() == "Less"
    QTest.mouseClick(group.more, LEFT)
    assert panel.search("gamma") == 1 and shown() == ["gamma"]
    panel.search("")
    assert shown() == ["exposure", "gain"]
    panel.show_editors([EXPOSURE, replace(rest, is_main=True), last])
    wait_until(lambda: shown() == ["exposure", "gamma", "gain"])
    assert not group.more.isVisible()


def test_a_value_that_none_can_have_is_told_in_place_of_another_one() -> None:
    """Oracle: what the row shows: no field with the default, which the stage does not have, but the
    sentence; the reset button authors the default, and the field is back."""
    wrong = replace(EXPOSURE, value=0.0, problem="/Sim.exposure: found 99, expected -16 to 16")
    panel = Panel(wrong)
    row = panel.row("exposure")
    assert not row.widget.isVisible() and row.problem.isVisible()
    assert row.problem.text().startswith("found 99") and row.problem.toolTip() == wrong.problem
    QTest.mouseClick(row.reset, LEFT)
    assert panel.changes == [("exposure", 0.0, "")]
    panel.show_editors([replace(EXPOSURE, value=0.0)])
    assert row.widget.isVisible() and not row.problem.isVisible()
