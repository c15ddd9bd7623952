"""Fields for the translation, the angles and the scale of the selected prim."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.viewport_overlays import COLORS
from usdsplat.preview.stage_model.poses import PARTS, Part, Pose

_TITLES = {"translate": "Translate", "rotate": "Rotate", "scale": "Scale"}
_UNITS = {"translate": "", "rotate": "°", "scale": ""}
_STEPS = {"translate": 0.1, "rotate": 1.0, "scale": 0.1}
"""Steps of an arrow key."""
_WORDS = {
    "translate": "Distance from the parent's origin along its {axis} [scene unit]",
    "rotate": "Angle about {axis}; about X first, then Y, then Z",
    "scale": "Factor along the prim's own {axis}",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A number that was entered for a prim."""

    path: str
    """Path of the prim."""
    pose: Pose
    """Pose that the fields showed when the number was entered."""
    part: Part
    axis: int
    """0 is x."""
    value: float
    merge: str
    """Key shared by steps in a row; "" for a typed number."""


class PoseFields(QWidget):
    """Three fields for each part of a pose; hidden for prims that cannot be moved."""

    entered = Signal(object)
    """Signal that the user has entered a number, with an `Entry`."""
    refused = Signal(str)
    """Emitted with an error message when a text is not a number."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.pose: Pose | None = None
        """The shown pose; None for none."""
        self._path = ""
        """Path of the prim that has it."""
        self.fields: dict[tuple[str, int], NumberField] = {}
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 6, 2)
        grid.setHorizontalSpacing(4)
        grid.setVerticalSpacing(3)
        for row, part in enumerate(PARTS):
            label = QLabel(_TITLES[part])
            label.setProperty("role", "quiet")
            grid.addWidget(label, row, 0)
            for axis, name in enumerate("XYZ"):
                field = NumberField(f"{_TITLES[part]} {name}", unit=_UNITS[part], step=_STEPS[part])
                field.setToolTip(_WORDS[part].format(axis=name))
                field.setStyleSheet(f"border-left: 2px solid {COLORS[name.lower()].name()};")
                field.entered.connect(partial(self._enter, part, axis))
                field.refused.connect(self.refused)
                grid.addWidget(field, row, axis + 1)
                grid.setColumnStretch(axis + 1, 1)
                self.fields[part, axis] = field
        self.hide()

    def show_pose(self, path: str, pose: Pose | None) -> None:
        """Show the pose of a prim, except in a field that is being typed into.

        What is being typed for another prim is entered for that one first: when the fields are
        hidden, they lose the focus and signal it, and it would be taken for this one.
        """
        if path != self._path:
            for field in self.fields.values():
                field.commit()
        self._path, self.pose = path, pose
        self.setVisible(pose is not None)
        if pose is not None:
            for (part, axis), field in self.fields.items():
                field.show_value(getattr(pose, part)[axis])

    def _enter(self, part: Part, axis: int, value: float) -> None:
        if self.pose is not None:
            merge = self.fields[part, axis].nudges
            self.entered.emit(
                Entry(
                    path=self._path,
                    pose=self.pose,
                    part=part,
                    axis=axis,
                    value=value,
                    merge=merge,
                )
            )
