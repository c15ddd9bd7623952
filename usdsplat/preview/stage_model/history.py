"""Record and restore a layer's opinions at some paths, for undo and redo.

Only the paths of a step are kept, as Sdf specs, so values of any type return exactly, including
time samples. Prims created by a step, and their new parents, are removed with it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pxr import Sdf

_MOST = 500
"""Most steps that can be undone."""


class Snapshot:
    """The opinions of a layer at some paths, and whether the layer has specs above them.

    Args:
        layer: The layer; it is not changed.
        paths: Paths of prims and properties that may be changed.
        whole: Paths whose whole subtree is kept.
    """

    def __init__(
        self, layer: Sdf.Layer, paths: Iterable[Sdf.Path], *, whole: Iterable[Sdf.Path] = ()
    ) -> None:
        self.paths = frozenset(paths)
        self.absent: list[Sdf.Path] = []
        """The topmost paths that have no spec in the layer."""
        self._fields: dict[Sdf.Path, dict[str, Any]] = {}
        self._copied: list[Sdf.Path] = []
        self._stash = Sdf.Layer.CreateAnonymous("undo")
        whole = frozenset(whole)
        seen: set[Sdf.Path] = set()
        for path in _with_ancestors(self.paths):
            if not seen.isdisjoint(path.GetPrefixes()):
                continue
            spec = layer.GetObjectAtPath(path)
            if spec is None:
                self.absent.append(path)
                seen.add(path)
            elif path in whole or path.IsPropertyPath():
                _copy(layer, self._stash, path)
                self._copied.append(path)
                seen.add(path)
            elif path in self.paths:
                self._fields[path] = _fields(spec)
        self._copied = _in_order(layer, self._copied)

    def restore(self, layer: Sdf.Layer) -> None:
        """Restore the layer's opinions at the paths, and remove newer ones."""
        with Sdf.ChangeBlock():
            for path in self.absent:
                _remove(layer, path)
            for path, fields in self._fields.items():
                _set_fields(Sdf.CreatePrimInLayer(layer, path), fields)
            for path in self._copied:
                _copy(self._stash, layer, path)


@dataclass(slots=True, kw_only=True)
class Step:
    """One edit that can be undone."""

    name: str
    merge: str | None
    before: Snapshot
    after: Snapshot | None = None
    """The opinions after the step, once it was undone."""
    merged: int = 0
    """Number of later steps that were merged into it."""


class History:
    """The done and the undone steps of one layer."""

    def __init__(self, layer: Sdf.Layer) -> None:
        self._layer = layer
        self._done: list[Step] = []
        self._undone: list[Step] = []

    @property
    def undoable(self) -> str | None:
        """Name of the step that `undo` takes back."""
        return self._done[-1].name if self._done else None

    @property
    def redoable(self) -> str | None:
        """Name of the step that `redo` repeats."""
        return self._undone[-1].name if self._undone else None

    @property
    def state(self) -> tuple[Step | None, int]:
        """What tells the present opinions from those at another time, as long as both are kept."""
        return (self._done[-1], self._done[-1].merged) if self._done else (None, 0)

    def add(self, step: Step) -> None:
        """Record a done step and forget the undone ones."""
        if self._done and not self._undone and _continues(step, self._done[-1]):
            self._done[-1].merged += 1
            return
        self._undone.clear()
        self._done.append(step)
        del self._done[:-_MOST]

    def undo(self) -> str | None:
        """Undo the last step."""
        if not self._done:
            return None
        step = self._done.pop()
        step.after = Snapshot(self._layer, step.before.paths, whole=step.before.absent)
        step.before.restore(self._layer)
        self._undone.append(step)
        return step.name

    def take_back(self, merge: str) -> None:
        """Undo the last step if it has this key, and forget it."""
        if self._done and self._done[-1].merge == merge:
            self._done.pop().before.restore(self._layer)

    def redo(self) -> str | None:
        """Redo the last undone step."""
        if not self._undone:
            return None
        step = self._undone.pop()
        if step.after is not None:
            step.after.restore(self._layer)
        step.merge = None  # the next step must not merge into it
        self._done.append(step)
        return step.name

    def clear(self) -> None:
        """Forget all steps; their opinions stay."""
        self._done.clear()
        self._undone.clear()


def _continues(step: Step, last: Step) -> bool:
    """Return whether a step merges into the last, so that one undo takes back both."""
    is_same = step.merge is not None and step.merge == last.merge
    return is_same and step.before.paths <= last.before.paths


def _with_ancestors(paths: Iterable[Sdf.Path]) -> list[Sdf.Path]:
    """Return the paths and their ancestors, the higher ones first."""
    found = {prefix for path in paths for prefix in path.GetPrefixes()}
    return sorted(found, key=lambda path: (path.pathElementCount, path))


def _in_order(layer: Sdf.Layer, paths: list[Sdf.Path]) -> list[Sdf.Path]:
    """Return paths of specs in the layer's sibling order, so that restoring keeps the order."""
    places: dict[Sdf.Path, dict[str, int]] = {}

    def place(path: Sdf.Path) -> int:
        above = path.GetParentPath()
        if above not in places:
            names = layer.GetObjectAtPath(above).nameChildren.keys()
            places[above] = {name: number for number, name in enumerate(names)}
        return places[above].get(path.name, 0)

    return sorted(paths, key=place)


def _fields(spec: Sdf.PrimSpec) -> dict[str, Any]:
    return {key: spec.GetInfo(key) for key in spec.ListInfoKeys()}


def _set_fields(spec: Sdf.PrimSpec, fields: dict[str, Any]) -> None:
    """Replace a prim spec's own fields."""
    for key in spec.ListInfoKeys():
        if key not in fields:
            spec.ClearInfo(key)
    for key, value in fields.items():
        if not spec.HasInfo(key) or spec.GetInfo(key) != value:
            spec.SetInfo(key, value)


def _copy(source: Sdf.Layer, target: Sdf.Layer, path: Sdf.Path) -> None:
    parent = path.GetParentPath()
    if parent != Sdf.Path.absoluteRootPath:
        Sdf.CreatePrimInLayer(target, parent)
    Sdf.CopySpec(source, path, target, path)


def _remove(layer: Sdf.Layer, path: Sdf.Path) -> None:
    spec = layer.GetObjectAtPath(path)
    if spec is None:
        return
    if path.IsPropertyPath():
        layer.GetPrimAtPath(path.GetPrimPath()).RemoveProperty(spec)
    else:
        edit = Sdf.BatchNamespaceEdit()
        edit.Add(path, Sdf.Path.emptyPath)
        layer.Apply(edit)
