"""Provenance of a bake: what it was made of, so that it can be reported, repeated and resumed."""

from __future__ import annotations

import hashlib
import importlib.metadata
import math
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

from usdsplat import __version__
from usdsplat.core.errors import FormatError, StageError
from usdsplat.core.file_hash import file_hash
from usdsplat.core.progress import phase
from usdsplat.schema.value_clips import clip_files, clipped_prims, file_of, layers_without_clips
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.recipe import UNGUARDED

KEY = ("usdsplat", "bake")
"""Key in customData and customLayerData, "usdsplat:bake" in USD's spelling."""
_BLOCK = 1 << 24
"""Bytes of a file that are hashed between reports of progress."""
_DIGITS = 12
"""Hexadecimal digits of the digest of one parameter."""
_TYPES: dict[str, type] = {
    "completedFrames": int,
    "mergedEpochs": int,
    "features": Vt.StringArray,
    "frameRange": Vt.DoubleArray,
    "inputHash": Vt.StringArray,
    "parameters": Vt.StringArray,
    "checkpoint": str,
}
"""Types of the entries of a record that are used for more than a comparison."""
_PREFIXES = (f"{NAMESPACE}:", f"primvars:{NAMESPACE}:", f"collection:{NAMESPACE}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Facts that are stored with a bake, and must be the same when it is resumed."""

    param_hash: str
    """The result of `parameter_hash`."""
    parameters: tuple[str, ...]
    """The result of `parameter_lines`, to name what differs."""
    input_hash: tuple[str, ...]
    """The result of `input_hash`."""
    seed: int
    substeps: int
    dt: float
    """[s]"""
    frame_range: tuple[float, float]
    """First and last frame [time code]."""
    mode: str
    threads: int
    """Number of threads; does not influence the result."""
    features: tuple[str, ...] = ()
    """What the simulation prepares for each field, "path: features"; it depends on all frames."""
    resolved: dict[str, dict[str, float]] = field(default_factory=dict)
    """Values of automatic parameters, by field; filled in when they are known."""

    def record(self, *, completed: int, checkpoint: str) -> dict[str, Any]:
        """Return the record as USD stores it.

        Args:
            completed: Frames whose samples are in the layer.
            checkpoint: Path of the checkpoint, relative to the layer; "" without one.
        """
        return {
            "solverVersion": __version__,
            "paramHash": self.param_hash,
            "parameters": Vt.StringArray(list(self.parameters)),
            "inputHash": Vt.StringArray(list(self.input_hash)),
            "seed": self.seed,
            "substeps": self.substeps,
            "dt": self.dt,
            "frameRange": Vt.DoubleArray(list(self.frame_range)),
            "completedFrames": completed,
            "mode": self.mode,
            "threads": self.threads,
            "cpu": _cpu(),
            "numba": importlib.metadata.version("numba"),
            "usd": ".".join(str(each) for each in Usd.GetVersion()[1:]),
            "checkpoint": checkpoint,
            "features": Vt.StringArray(list(self.features)),
            "resolved": {path: dict(found) for path, found in self.resolved.items()},
        }

    def check(self, target: Path, other: Mapping[str, Any], *, without: Sequence[str] = ()) -> None:
        """Compare with the record of a bake that is to be resumed.

        Args:
            target: The bake.
            other: Its record.
            without: Entries that may differ.

        Raises:
            StageError: If it was made of something else; the message names the difference.
        """
        mine = self.record(completed=0, checkpoint="")
        names = {
            "solverVersion": "version of usdsplat",
            "mode": "mode",
            "frameRange": "frame range",
            "seed": "seed",
            "substeps": "substeps",
            "dt": "dt",
            "paramHash": "parameters",
            "inputHash": "input files",
        }
        for key, name in names.items():
            if key in without:
                continue
            if _plain(other.get(key)) == _plain(mine[key]):
                continue
            found = f"other {name}" if "Hash" in key else f"another {name}"
            if key == "inputHash":
                found += f" ({', '.join(_differing(other.get(key) or (), self.input_hash))})"
            elif key != "paramHash":
                found += f", {_plain(mine[key])}"
            elif differing := _differing(other.get("parameters") or (), self.parameters):
                found += f", the first is {differing[0]}" if "parameters" in other else ""
            expected = "those that the bake was started with"
            expected += " (--set too), or a new bake" if key == "paramHash" else ", or a new bake"
            if key not in ("paramHash", "inputHash"):
                expected = f"{_plain(other.get(key))}, as when the bake was started, or a new bake"
            raise StageError(f"{target}, resumed", found, expected)


def parameter_hash(stage: Usd.Stage, times: Sequence[float]) -> str:
    """Return SHA-256 over all opinions of a simulation at all frames, and over the prims and
    variants on the stage, which a session may change. Files of masks count by their authored paths
    and contents, so that a moved bake can be resumed.

    Args:
        stage: Properties under `splatSim:` are read from every prim.
        times: The frames [time code].
    """
    total = hashlib.sha256(repr([float(time) for time in times]).encode())
    for prim in stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
        variants = sorted(prim.GetVariantSets().GetAllVariantSelections().items())
        total.update(f"{prim.GetPath()} {prim.IsActive()} {variants}\0".encode())
        for item in prim.GetAuthoredProperties():
            if item.GetName().startswith(_PREFIXES):
                total.update(f"{item.GetPath()}\0".encode())
                for text in _opinions(item, times):
                    total.update(text)
    return total.hexdigest()


def parameter_lines(stage: Usd.Stage, times: Sequence[float]) -> tuple[str, ...]:
    """Return "digest  path" of each property that `parameter_hash` counts, sorted by path.

    Args:
        stage, times: As for `parameter_hash`.
    """
    lines = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
        for item in prim.GetAuthoredProperties():
            if item.GetName().startswith(_PREFIXES):
                digest = hashlib.sha256(b"".join(_opinions(item, times))).hexdigest()[:_DIGITS]
                lines.append((str(item.GetPath()), digest))
    return tuple(f"{digest}  {path}" for path, digest in sorted(lines))


def input_hash(
    stage: Usd.Stage,
    without: Iterable[str] = (),
    chunks: Iterable[str] = (),
    *,
    reading: AbstractContextManager[Any] = UNGUARDED,
) -> tuple[str, ...]:
    """Return SHA-256 of every layer that a stage is made of, value clips and chunks of splat trees
    included, "hash  path" each, sorted by path.

    Args:
        stage: Layers on disk count as files, edits in memory as text.
        without: Identifiers of layers to skip.
        chunks: Resolved paths of chunks, which no stage composes.
        reading: Entered while the stage is read, but not while files are, which may be large.
    """
    files = {Path(file_of(path)) for path in chunks}
    lines = []
    skipped = set(without)
    with reading:
        root = Path(stage.GetRootLayer().realPath or ".").parent
        files.update(map(Path, clip_files(clipped_prims(stage))))
        for layer in layers_without_clips(stage):
            if layer.identifier in skipped:
                continue
            if layer.realPath and not layer.dirty:
                files.add(Path(file_of(layer.realPath)))
            elif not layer.empty:
                digest = hashlib.sha256(layer.ExportToString().encode()).hexdigest()
                lines.append((layer.GetDisplayName(), digest))
    total = sum(path.stat().st_size for path in files)
    with phase("hashing the inputs", total=max(math.ceil(total / _BLOCK), 1)) as hashing:
        read = 0
        for path in sorted(files):
            content = hashlib.sha256()
            with path.open("rb") as file:
                while block := file.read(_BLOCK):
                    content.update(block)
                    read += len(block)
                    hashing.step(read // _BLOCK)
            lines.append((os.path.relpath(path, root), content.hexdigest()))
    return tuple(f"{digest}  {name}" for name, digest in sorted(lines))


def read_record(layer: Sdf.Layer) -> Mapping[str, Any] | None:
    """Return the record in a bake's root layer, or None; see `well_typed`."""
    entry: Any = layer.customLayerData
    for key in KEY:
        entry = entry.get(key) if isinstance(entry, Mapping) else None
    return well_typed(entry) if isinstance(entry, Mapping) else None


def baked_frames(stage: Usd.Stage) -> tuple[float, float] | None:
    """Return the first and last frame of the strongest bake among the layers of a stage [time
    code]; None without a bake."""
    for layer in stage.GetLayerStack(includeSessionLayers=False):
        span = (read_record(layer) or {}).get("frameRange", ())
        if len(span) == 2:
            return float(span[0]), float(span[1])
    return None


def known_record(target: Path) -> Mapping[str, Any] | None:
    """Return the record of the bake at a path, or None."""
    if not target.exists():
        return None
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(target))
    except RuntimeError as error:  # pxr's error for a file that cannot be read
        raise FormatError(str(target), "a damaged file", "a layer of results") from error
    record = read_record(layer)
    if record is None:
        raise StageError(
            str(target), "a layer that is not a bake", "a bake to resume, or a new name"
        )
    return record


def well_typed(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record without entries of other types than `Provenance.record` writes."""
    known: dict[str, Any] = {
        key: value for key, value in record.items() if isinstance(value, _TYPES.get(key, object))
    }
    span = list(known.get("frameRange", ()))
    if len(span) != 2 or not all(map(math.isfinite, span)):
        known.pop("frameRange", None)
    return known


def nested(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record nested in dictionaries, as KEY names them."""
    return {KEY[0]: {KEY[1]: dict(record)}}


def _opinions(item: Usd.Property, times: Sequence[float]) -> Iterator[bytes]:
    """Return the value of a property, at all frames if it changes."""
    if isinstance(item, Usd.Relationship):
        yield repr([str(path) for path in item.GetTargets()]).encode()
        return
    yield str(item.GetTypeName()).encode()
    codes = [Usd.TimeCode.Default()]
    if item.ValueMightBeTimeVarying() or item.GetNumTimeSamples():  # a sample hides the default
        codes += [Usd.TimeCode(time) for time in times]
    for code in codes:
        value = item.Get(code)
        if isinstance(value, Sdf.AssetPath | Sdf.AssetPathArray):
            files = [value] if isinstance(value, Sdf.AssetPath) else value
            yield repr([(each.path, _content(each.resolvedPath)) for each in files]).encode()
            continue
        is_array = hasattr(value, "__len__") and not isinstance(value, str)
        numbers = np.asarray(value) if is_array else None
        if numbers is not None and numbers.dtype.kind in "biuf":
            yield np.ascontiguousarray(numbers).tobytes()
        else:
            yield repr(value).encode()


def _content(path: str) -> str:
    """Return the SHA-256 of a file that an asset path leads to; "" if there is none."""
    file = Path(file_of(path))
    if not path or not file.is_file():
        return ""
    return file_hash(str(file))


def _plain(value: Any) -> Any:
    """Return a value that can be compared: USD returns its own array types."""
    is_array = hasattr(value, "__len__") and not isinstance(value, str)
    return list(value) if is_array else value


def _differing(first: Iterable[str], second: Iterable[str]) -> list[str]:
    """Return the names of files that differ in two lists."""
    return sorted({line.split("  ", 1)[-1] for line in set(first) ^ set(second)})


def _cpu() -> str:
    """Return the name of the processor: results of another one may differ in the last bits."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
