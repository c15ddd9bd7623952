"""Keep the asset paths of a layer valid in a copy that is written to another folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pxr import Sdf, UsdUtils

from usdsplat.core.errors import StageError
from usdsplat.core.readable import is_utf8, original
from usdsplat.core.text import shown

_CLIPS = "clips"
_TEMPLATE = "templateAssetPath"
"""Pattern of the files of value clips: a string, which USD does not treat as an asset path."""
_WITHOUT_PATHS = {"subLayerOffsets", "customData", "documentation", "comment"}
"""Metadata that has no asset paths, or whose paths are not searched for expressions."""


def make_absolute(copy: Sdf.Layer, source: Sdf.Layer) -> set[str]:
    """Replace the relative asset paths of a copy by absolute ones.

    Args:
        copy: A copy of `source` without a file.
        source: The layer that the paths are relative to. Paths in a layer without a file stay.

    Returns:
        The paths that were replaced.
    """
    replaced = set()

    def absolute(path: str) -> str:
        if not path or path.startswith("anon:") or os.path.isabs(path) or _is_expression(path):
            return path
        found = str(Sdf.ComputeAssetPathRelativeToLayer(source, path))
        if not os.path.isabs(found):
            return path
        replaced.add(found)
        return found

    if not source.anonymous:
        _modify(copy, absolute)
    return replaced


def make_relative(layer: Sdf.Layer, absolute: set[str], *, source: str, target: Path) -> None:
    """Replace absolute asset paths by ones that are relative to a target file.

    Paths beside a link of `core.readable` become those beside the file that is linked.

    Args:
        layer: The layer, which will be written to `target`.
        absolute: The paths to replace; others stay.
        source: File that the layer was copied from: paths to it become paths to `target`.
        target: File that the layer will be written to. Paths of a package stay absolute but for
            those to itself, because packing copies the files.

    Raises:
        StageError: If the path of a file is not UTF-8, in which USD writes paths.
    """
    folder = os.path.abspath(target.parent)

    def relative(path: str) -> str:
        if path not in absolute:
            return path
        if path == source:
            return f"./{shown(target.name)}"
        if target.suffix.lower() == ".usdz":
            return path
        found = os.path.relpath(original(path), folder)
        return found if found.startswith("..") else f"./{found}"

    _modify(layer, relative)


def replace_links(layer: Sdf.Layer) -> None:
    """Replace absolute paths of links of `core.readable` by those of the linked files, in which
    bytes that are not UTF-8 are escaped."""
    _modify(layer, lambda path: shown(original(path)) if original(path) != path else path)


Expressions = list[tuple[Sdf.Path, str, Any]]
"""Values with asset paths that are expressions: (path, field, value) of specs."""


def expressions(layer: Sdf.Layer) -> Expressions:
    """Return the values with asset paths that are expressions, those in custom data excepted.

    USD evaluates such paths where `make_absolute` and `make_relative` replace paths.
    """
    found: Expressions = []

    def visit(path: Sdf.Path) -> None:
        spec = layer.GetObjectAtPath(path)
        if spec is None:
            return
        keys = set(spec.ListInfoKeys()) - _WITHOUT_PATHS
        if path.IsPropertyPath() and not _holds_paths(spec):
            keys -= {"default", "timeSamples"}
        found.extend((path, key, spec.GetInfo(key)) for key in keys if _has_expression(spec, key))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found


def restore(layer: Sdf.Layer, values: Expressions) -> None:
    """Write values that `expressions` returned again."""
    for path, key, value in values:
        if key == "subLayers":
            with _kept_offsets(layer):
                layer.subLayerPaths = value
        elif key == "timeSamples":
            for time, sample in value.items():
                layer.SetTimeSample(path, time, sample)
        else:
            layer.GetObjectAtPath(path).SetInfo(key, value)


def _holds_paths(spec: Sdf.PropertySpec) -> bool:
    """Return whether the values of a property are asset paths."""
    kinds = (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray)
    return isinstance(spec, Sdf.AttributeSpec) and spec.typeName in kinds


def _has_expression(spec: Sdf.Spec, key: str) -> bool:
    """Return whether the text of a value has the mark of an expression."""
    return "`" in str(spec.GetInfo(key))


@contextmanager
def _kept_offsets(layer: Sdf.Layer) -> Iterator[None]:
    """Restore the time offsets of sublayers, which USD removes where it replaces their paths."""
    offsets = list(layer.subLayerOffsets)
    yield
    for place, offset in enumerate(offsets):
        layer.subLayerOffsets[place] = offset


def _is_expression(path: str) -> bool:
    return bool(Sdf.VariableExpression.IsExpression(path))


def _modify(layer: Sdf.Layer, change: Callable[[str], str]) -> None:
    """Apply a function to all asset paths of a layer, patterns of value clips included.

    Raises:
        StageError: If it returns a path that is not UTF-8.
    """
    wrong: list[str] = []

    def changed(path: str) -> str:
        found = change(path)
        if is_utf8(found):
            return found
        wrong.append(found)
        return path

    with _kept_offsets(layer):
        UsdUtils.ModifyAssetPaths(layer, changed, True)

    def visit(path: Sdf.Path) -> None:
        is_prim = path.IsPrimPath() or path.IsPrimVariantSelectionPath()
        spec = layer.GetPrimAtPath(path) if is_prim else None
        if spec is None or not spec.HasInfo(_CLIPS):
            return
        sets: dict[str, Any] = dict(spec.GetInfo(_CLIPS))
        for name, values in sets.items():
            if isinstance(values, dict) and isinstance(values.get(_TEMPLATE), str):
                sets[name] = {**values, _TEMPLATE: changed(values[_TEMPLATE])}
        spec.SetInfo(_CLIPS, sets)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    if wrong:
        expected = "a name that a layer can refer to"
        raise StageError(wrong[0], "a name that is not UTF-8", expected)
