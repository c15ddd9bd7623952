"""Fields for the translation, the angles and the scale of the selected prim."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from usdsplat.preview.qt.number_field import NumberField
from usdsplat.preview.qt.viewport_overlays import COLORS
from usdsplat.preview.stage_model.poses import PARTS, Pose

_TITLES = {"translate": "Translate", "rotate": "Rotate", "scale": "Scale"}
_UNITS = {"translate": "", "rotate": "°", "scale": ""}
_STEPS = {"translate": 0.1, "rotate": 1.0, "scale": 0.1}
"""Steps of an arrow key."""
_WORDS = {
    "translate": "Distance from the parent's origin along its {axis} [scene unit]",
    "rotate": "Angle about {axis}; about X first, then Y, then Z",
    "scale": "Factor along the prim's own {axis}",
}


class PoseFields(QWidget):
    """Three fields for each part of a pose; hidden for prims that cannot be moved."""

    entered = Signal(str, int, float)
    """Part, axis (0 is x) and the new number."""
    refused = Signal(str)
    """Error message if a text is not a number."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.pose: Pose | None = None
        """The shown pose; None for none."""
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
                field.entered.connect(partial(self.entered.emit, part, axis))
                field.refused.connect(self.refused)
                grid.addWidget(field, row, axis + 1)
                grid.setColumnStretch(axis + 1, 1)
                self.fields[part, axis] = field
        self.hide()

    def show_pose(self, pose: Pose | None) -> None:
        """Show a pose, except in a field that is being typed into."""
        self.pose = pose
        self.setVisible(pose is not None)
        if pose is not None:
            for (part, axis), field in self.fields.items():
                field.show_value(getattr(pose, part)[axis])
