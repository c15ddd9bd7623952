"""Write a layer of time samples incrementally, so that memory holds one frame."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, UsdUtils

from usdsplat.core.output import OutputFile, output_file
from usdsplat.core.progress import steps
from usdsplat.schema.usd_files import is_whole_usd, new_layer, save_layer

_UPGRADE = "requires crate version"


class SampleLayer:
    """Writer of time samples on `over`s."""

    def __init__(self, layer: Sdf.Layer) -> None:
        self.layer = layer

    def prim(self, path: str, type_name: str = "") -> Sdf.PrimSpec:
        """Return the prim; a type retypes it."""
        spec = Sdf.CreatePrimInLayer(self.layer, path)
        if type_name and spec.typeName != type_name:
            spec.typeName = type_name
        return spec

    def attribute(
        self, path: str, name: str, kind: Sdf.ValueTypeName, *, uniform: bool = False
    ) -> Sdf.AttributeSpec:
        """Return an attribute of the prim."""
        found = self.layer.GetAttributeAtPath(f"{path}.{name}")
        if found:
            return found
        variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
        return Sdf.AttributeSpec(self.prim(path), name, kind, variability)

    def sample(
        self, path: str, name: str, kind: Sdf.ValueTypeName, value: Any, time: float
    ) -> Sdf.AttributeSpec:
        """Write a value at a time."""
        spec = self.attribute(path, name, kind)
        self.layer.SetTimeSample(spec.path, time, value)
        return spec


class SampleFile(SampleLayer):
    """A sample layer in the file of an output that is being written."""

    def __init__(self, layer: Sdf.Layer, output: OutputFile) -> None:
        super().__init__(layer)
        self._output = output

    def save(self) -> None:
        """Save to disk, and release the memory of what was written.

        Raises:
            OutputError: If the file cannot be written.
        """
        with _quiet_upgrade():
            save_layer(self.layer, self._output)


@contextmanager
def new_part(target: Path, rate: float) -> Iterator[SampleFile]:
    """Write a layer that appears at `target` when it is complete.

    Args:
        target: A .usdc.
        rate: Time codes per second.

    Raises:
        OutputError: If it cannot be written.
    """
    with output_file(target, is_whole=is_whole_usd) as output:
        part = SampleFile(new_layer(output.path, output), output)
        part.layer.timeCodesPerSecond = rate
        yield part
        part.save()
        del part


def declare(source: Sdf.Layer, target: Sdf.Layer, without: Sequence[str] = ()) -> None:
    """Copy all opinions of `source` to `target`, except time samples and the default values of the
    attributes `without`."""

    def visit(path: Sdf.Path) -> None:
        if not path.IsPrimPath():
            return
        prim = source.GetPrimAtPath(path)
        copy = Sdf.CreatePrimInLayer(target, path)
        for key in sorted(prim.ListInfoKeys()):
            if key not in ("specifier", "typeName") or prim.GetInfo(key):
                copy.SetInfo(key, prim.GetInfo(key))
        for spec in prim.properties:
            if isinstance(spec, Sdf.AttributeSpec):
                known = target.GetAttributeAtPath(spec.path)
                new = known or Sdf.AttributeSpec(copy, spec.name, spec.typeName, spec.variability)
                # unsorted, the keys are in the order of their memory addresses
                for key in sorted(spec.ListInfoKeys()):
                    if key not in ("timeSamples", "typeName", "variability", "default"):
                        new.SetInfo(key, spec.GetInfo(key))
                if spec.HasDefaultValue() and str(spec.path) not in without:
                    new.default = spec.default  # SetInfo would take tokens for strings
            else:
                Sdf.CopySpec(source, spec.path, target, spec.path)

    source.Traverse(Sdf.Path.absoluteRootPath, visit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Samples of a file from one time to another."""

    path: Path
    first: float = -math.inf
    """First time [time code]."""
    end: float = math.inf
    """Time of the first sample after the last one [time code]."""


def merge(parts: Sequence[Part], target: Path, rate: float, silenced: Sequence[str] = ()) -> None:
    """Merge the samples of several parts into one file.

    The bytes of the file depend on the samples of each part only, not on the files that they are
    in.

    Args:
        parts: In order of time, at least one; they may be in the file that is replaced.
        target: A .usdc.
        rate: Time codes per second.
        silenced: Attributes whose default values in weaker layers are blocked.

    Raises:
        OutputError: If it cannot be written.
    """
    with output_file(target, is_whole=is_whole_usd) as output:
        whole = SampleFile(new_layer(output.path, output), output)
        whole.layer.timeCodesPerSecond = rate
        for number in steps("merging the samples", len(parts)):
            _append(whole.layer, parts[number], silenced)
            whole.save()
        for name in silenced:
            whole.layer.GetAttributeAtPath(name).default = Sdf.ValueBlock()
        whole.save()
        del whole


def _append(whole: Sdf.Layer, part: Part, silenced: Sequence[str]) -> None:
    """Append the samples of a part."""
    layer = Sdf.Layer.OpenAsAnonymous(str(part.path))
    declare(layer, whole, silenced)
    for attribute in sampled(layer):
        for time in layer.ListTimeSamplesForPath(attribute):
            if part.first <= time < part.end:
                whole.SetTimeSample(attribute, time, layer.QueryTimeSample(attribute, time))


def sampled(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the attributes that have samples."""
    found: list[Sdf.Path] = []

    def visit(path: Sdf.Path) -> None:
        if path.IsPropertyPath() and layer.GetNumTimeSamplesForPath(path):
            found.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found


@contextmanager
def _quiet_upgrade() -> Iterator[None]:
    """Suppress USD's message that array edits need a newer file version than its default."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        others = delegate.TakeUncoalescedDiagnostics()
        del delegate
        for each in others:
            if _UPGRADE not in each.commentary:
                Tf.Warn(each.commentary)
