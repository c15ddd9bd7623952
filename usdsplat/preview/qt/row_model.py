"""Qt table model of frozen rows; equal keys keep their position and selection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QObject, Qt

_Index = QModelIndex
_ROOT = QModelIndex()


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column: the data of a row by Qt's roles."""

    title: str
    text: Callable[[Any], str]
    data: Callable[[Any, int], Any] = lambda row, role: None
    is_editable: Callable[[Any], bool] = lambda row: False


class RowModel(QAbstractTableModel):
    """A table of frozen rows.

    Args:
        columns: Columns of the table.
        key: Function that returns the identity of a row.
    """

    def __init__(
        self,
        columns: Sequence[Column],
        *,
        key: Callable[[Any], str],
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self._columns = tuple(columns)
        self._key = key
        self.rows: tuple[Any, ...] = ()

    def show_rows(self, rows: Sequence[Any]) -> None:
        """Replace the rows."""
        is_same = [self._key(row) for row in rows] == [self._key(row) for row in self.rows]
        if not is_same:
            self.beginResetModel()
            self.rows = tuple(rows)
            self.endResetModel()
            return
        changed = [
            i for i, (old, new) in enumerate(zip(self.rows, rows, strict=True)) if old != new
        ]
        self.rows = tuple(rows)
        for number in changed:
            first, last = (self.index(number, column) for column in (0, len(self._columns) - 1))
            self.dataChanged.emit(first, last)

    # --- Qt's -------------------------------------------------------------------------------

    def rowCount(self, parent: _Index = _ROOT) -> int:  # type: ignore[override]
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:  # type: ignore[override]
        return 0 if parent.isValid() else len(self._columns)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        is_title = role == Qt.ItemDataRole.DisplayRole and orientation == Qt.Orientation.Horizontal
        return self._columns[section].title if is_title else None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:  # type: ignore[override]
        if not index.isValid():
            return None
        row, column = self.rows[index.row()], self._columns[index.column()]
        return column.text(row) if role == Qt.ItemDataRole.DisplayRole else column.data(row, role)

    def flags(self, index: _Index) -> Qt.ItemFlag:  # type: ignore[override]
        found = super().flags(index)
        if index.isValid() and self._columns[index.column()].is_editable(self.rows[index.row()]):
            found |= Qt.ItemFlag.ItemIsEditable
        return found
