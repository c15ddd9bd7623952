"""Panel of pixel values, picked splats and a histogram."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QGridLayout, QLabel, QVBoxLayout, QWidget

from usdsplat.preview.histogram import Histogram, histogram
from usdsplat.preview.picking import Picked, in_box, pick
from usdsplat.preview.probe import Probed, probe
from usdsplat.preview.qt import style
from usdsplat.preview.qt.histogram_plot import HistogramPlot
from usdsplat.preview.qt.panel_context import PanelContext, Question
from usdsplat.preview.qt.render_panel import scrolling
from usdsplat.preview.qt.viewport import Viewport
from usdsplat.preview.qt.viewport_figures import lights_in
from usdsplat.preview.qt.viewport_holds import Rectangle
from usdsplat.preview.values import Picture

Rows = Sequence[tuple[str, str]]


class ProbePanel(QWidget):
    """A panel that follows the pointer while visible; picks persist."""

    def __init__(
        self, context: PanelContext, viewport: Viewport, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._context, self._viewport = context, viewport
        self._place = (0.0, 0.0)
        self._pointer = Question(self, self._ask_pixel)
        self._counts = Question(self, self._ask_counts)
        self.pixel = _Numbers("Move the pointer over the picture")
        self.picked = _Numbers("Click a splat or a mesh")
        self.swatch = QLabel()
        self.swatch.setFixedHeight(18)
        self.plot = HistogramPlot()
        body = QWidget()
        column = QVBoxLayout(body)
        column.setContentsMargins(8, 8, 8, 8)
        column.setSpacing(5)
        for title, widgets in (
            ("Pixel", (self.swatch, self.pixel)),
            ("Picked", (self.picked,)),
            ("Histogram", (self.plot,)),
        ):
            heading = QLabel(title)
            heading.setProperty("role", "heading")
            column.addWidget(heading)
            for widget in widgets:
                column.addWidget(widget)
            column.addSpacing(8)
        column.addStretch(1)
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.addWidget(scrolling(body))
        viewport.probe_moved.connect(self._moved)
        viewport.pick_requested.connect(self._pick)
        viewport.box_requested.connect(self._pick_in)
        context.proxy.picture.connect(self._drawn)

    # --- private ----------------------------------------------------------------------------

    def _moved(self, x: float, y: float) -> None:
        self._place = (x, y)
        self._pointer.refresh()

    def _drawn(self, picture: Picture) -> None:
        if picture.is_final:
            self._counts.refresh()

    def _ask_pixel(self, done: Callable[[], None]) -> None:
        def answered(found: Probed | None) -> None:
            done()
            self.show_pixel(found)

        x, y = self._place
        self._context.proxy.ask(
            lambda document: probe(document, x, y), answered, lambda error: done()
        )

    def _ask_counts(self, done: Callable[[], None]) -> None:
        def answered(found: Histogram | None) -> None:
            done()
            self.show_counts(found)

        self._context.proxy.ask(histogram, answered, lambda error: done())

    def _pick(self, x: float, y: float, adds: bool) -> None:
        self._context.proxy.interrupt()
        self._context.proxy.ask(
            lambda document: pick(document, x, y), partial(self._show_picked, adds)
        )

    def _show_picked(self, adds: bool, found: Picked | None) -> None:
        """Select what was picked; with `adds` beside the others, or no longer if it was."""
        before = self._context.viewer.state.selected if adds else ()
        picked = (found.path,) if found else ()
        kept = tuple(path for path in before if path not in picked)
        self._context.viewer.select((*kept, *(path for path in picked if path not in before)))
        self.show_picked(found)

    def _pick_in(self, box: Rectangle, adds: bool) -> None:
        """Select what is in a box; with `adds` beside the others."""
        viewer, targets = self._context.viewer, self._viewport.targets
        lit = (
            () if targets.projection is None else lights_in(targets.lights, box, targets.projection)
        )

        def answered(seen: tuple[str, ...]) -> None:
            found = (*seen, *lit)
            kept = tuple(each for each in viewer.state.selected if adds and each not in found)
            viewer.select((*kept, *found))

        self._context.proxy.interrupt()
        self._context.proxy.ask(lambda document: in_box(document, *box), answered)

    def show_pixel(self, found: Probed | None) -> None:
        """Show the values of a pixel."""
        if found is None:
            self.pixel.show_rows(())
            return
        color = QColor.fromRgbF(*(min(max(part, 0.0), 1.0) for part in found.shown))
        self.swatch.setStyleSheet(f"background: {color.name()}; border-radius: 3px;")
        rows = [
            ("Pixel", f"{found.x}, {found.y}"),
            ("On the screen", _numbers(found.shown, 3)),
            ("8 bit", " ".join(f"{round(255 * part):>4d}" for part in found.shown)),
            ("Before the view", _numbers(found.rendered)),
        ]
        if found.aov != "color":
            rows += [
                (channel, _number(value))
                for channel, value in zip(found.channels, found.values, strict=True)
            ]
        if found.position is not None:
            rows.append(("P", _numbers(found.position)))
        if found.path:
            rows += [("Prim", found.path), ("Face or splat", f"{found.element:,}")]
        self.pixel.show_rows(rows)

    def show_picked(self, found: Picked | None) -> None:
        """Show the values of a pick."""
        self.picked.show_rows(() if found is None else _picked_rows(found))

    def show_counts(self, found: Histogram | None) -> None:
        """Show a histogram."""
        if found is None:
            self.plot.show_counts((), lowest="", highest="")
            return
        curves = (("R", found.red), ("G", found.green), ("B", found.blue))
        self.plot.show_counts(curves, lowest="0", highest="255")


class _Numbers(QWidget):
    """A list of labels and values.

    Args:
        invitation: Text shown while the list is empty.
    """

    def __init__(self, invitation: str) -> None:
        super().__init__()
        self._invitation = invitation
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(8)
        self._grid.setVerticalSpacing(2)
        self._grid.setColumnStretch(1, 1)
        self._cells: list[tuple[QLabel, QLabel]] = []
        self.show_rows(())

    @property
    def rows(self) -> dict[str, str]:
        """The displayed values by label."""
        return {name.text(): value.text() for name, value in self._cells if not name.isHidden()}

    def show_rows(self, rows: Rows) -> None:
        """Show rows."""
        wanted = list(rows) or [(self._invitation, "")]
        while len(self._cells) < len(wanted):
            self._add_row()
        for number, (name, value) in enumerate(self._cells):
            is_used = number < len(wanted)
            name.setVisible(is_used)
            value.setVisible(is_used)
            if is_used:
                name.setText(wanted[number][0])
                value.setText(wanted[number][1])
                value.setToolTip(wanted[number][1])

    def _add_row(self) -> None:
        name, value = QLabel(), QLabel()
        name.setProperty("role", "quiet")
        value.setFont(style.digits())
        value.setWordWrap(True)
        value.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        value.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        row = len(self._cells)
        self._grid.addWidget(name, row, 0)
        self._grid.addWidget(value, row, 1)
        self._cells.append((name, value))


def _numbers(values: Sequence[float], digits: int = 4) -> str:
    return "  ".join(f"{value:.{digits}g}" for value in values)


def _number(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:.5g}"


def _picked_rows(found: Picked) -> Rows:
    """Return the rows of a pick."""
    rows = [
        ("Prim", found.path),
        ("Kind", found.kind),
        ("Face" if found.splat is None else "Splat", f"{found.element:,}"),
    ]
    if found.instance:
        rows.append(("Instance", f"{found.instance:,}"))
    rows.append(("Seen at", _numbers(found.position)))
    if found.splat is not None:
        splat = found.splat
        if splat.id != found.element:  # that of a splat without one is its row
            rows.append(("Id", f"{splat.id:,}"))
        rows += [
            ("Centre", _numbers(splat.center)),
            ("In the world", _numbers(splat.world_center)),
            ("Scales", _numbers(splat.scales)),
            ("Rotation wxyz", _numbers(splat.rotation)),
            ("Opacity", _number(splat.opacity)),
            ("Colour", _numbers(splat.color)),
            ("SH degree", str(splat.sh_degree)),
        ]
    return rows
