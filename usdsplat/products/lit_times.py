"""The splats of a stage, lit at one time, and the folder in which they wait for others.

`relit.usdc` is written of the files in `relit.usdc.parts`, one for each time. A file states of what
it was made; one of another stage, of other options or of another device does not count.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdLux, UsdShade

from usdsplat import __version__
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.core.file_hash import file_hash
from usdsplat.core.findings import Finding
from usdsplat.core.output import remove_stale
from usdsplat.products.source_hash import source_hash
from usdsplat.schema.stage_values import in_world
from usdsplat.schema.value_clips import clip_assets, file_of, layers_without_clips
from usdsplat.sim.arrays_file import load_arrays, save_arrays

_ARRAYS = ("positions", "scales", "rotations", "opacities", "sh")
"""Arrays of a cloud of which its colours are authored, see `schema.author_radiance`."""
_SUFFIX = ".lit"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LitField:
    """A field, lit at one time."""

    cloud: SplatCloud
    """Its splats, with new harmonics."""
    error: float
    """See `FieldRelight`."""
    worst: float
    residual: float | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LitTime:
    """A stage, lit at one time."""

    findings: tuple[Finding, ...]
    """What the stage asks for and does not get at this time."""
    has_lights: bool
    fields: Mapping[str, LitField]
    """Path -> field, without those that are not lit at this time."""


class LitFolder:
    """The files of the times at which a stage was lit, beside the layer that is written of them.

    Each file appears whole or not at all.

    Args:
        target: The layer.
        stamp: See `stamp_of`.
    """

    def __init__(self, target: Path, stamp: str) -> None:
        self.path = folder_of(target)
        self._stamp = stamp

    def load(self, number: int) -> LitTime | None:
        """Return the stage at the time with a number; None if it was not lit, or is stale."""
        path = self._file(number)
        try:
            arrays, known = load_arrays(path) if path.is_file() else ({}, {})
        except (FormatError, OSError):
            return None
        if known.get("stamp") != self._stamp:
            return None
        fields = {
            each["path"]: LitField(
                cloud=SplatCloud(**{name: arrays[f"{name}:{each['path']}"] for name in _ARRAYS}),
                error=each["error"],
                worst=each["worst"],
                residual=each["residual"],
            )
            for each in known["fields"]
        }
        findings = tuple(Finding(**each) for each in known["findings"])
        return LitTime(findings=findings, has_lights=known["has_lights"], fields=fields)

    def save(self, number: int, lit: LitTime) -> None:
        """Store the stage at the time with a number.

        Raises:
            OutputError: If the file cannot be written.
        """
        arrays = {
            f"{name}:{path}": getattr(each.cloud, name)
            for path, each in lit.fields.items()
            for name in _ARRAYS
        }
        fields = [
            {"path": path, "error": each.error, "worst": each.worst, "residual": each.residual}
            for path, each in lit.fields.items()
        ]
        meta: dict[str, Any] = {
            "stamp": self._stamp,
            "has_lights": lit.has_lights,
            "findings": [asdict(each) for each in lit.findings],
            "fields": fields,
        }
        save_arrays(self._file(number), arrays, meta)

    def remove(self) -> None:
        """Remove the folder; what cannot be removed stays, such as files of another user."""
        with suppress(OSError):  # there is none, or another process removes it
            for path in list(self.path.glob(f"*{_SUFFIX}")):
                with suppress(OSError):
                    path.unlink()
            remove_stale(self.path)
            self.path.rmdir()

    def _file(self, number: int) -> Path:
        return self.path / f"{number:06d}{_SUFFIX}"


def folder_of(target: Path) -> Path:
    """Return the folder of a layer's `LitFolder`."""
    return target.with_name(f"{target.name}.parts")


def stamp_of(stage: Usd.Stage, device: str, values: Sequence[object], picture: Path | None) -> str:
    """Return hexadecimal digits that are equal if the same stage is lit in the same way.

    Layers and pictures count by their contents, value clips by name, size and time: those of a
    sequence are too many to be read for each of its parts.

    Args:
        stage: The stage, whose layers have no unsaved edits but for the session layer.
        device: Name of the device.
        values: What else decides the colours; by their `repr`.
        picture: The picture of `--captured-hdri`.
    """
    session = stage.GetSessionLayer()
    layers = {file_of(each.realPath) for each in layers_without_clips(stage) if each.realPath}
    read = sorted({*_pictures(stage), *([] if picture is None else [str(picture)])})
    clips = {asset.resolvedPath for _, asset in clip_assets(in_world(stage))}
    parts = [
        __version__,
        device,
        *map(repr, values),
        source_hash(sorted(layers)),
        session.ExportToString() if session else "",
        *sorted(map(str, stage.GetPopulationMask().GetPaths())),
        *(_content(path) for path in read),
        *sorted(map(_version, map(file_of, clips))),
    ]
    return hashlib.sha256("\0".join(parts).encode(errors="surrogateescape")).hexdigest()


def _pictures(stage: Usd.Stage) -> Iterator[str]:
    """Yield the files that lights and shaders of a stage name."""
    for prim in in_world(stage):
        if not (prim.HasAPI(UsdLux.LightAPI) or prim.IsA(UsdShade.Shader)):
            continue
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetTypeName() != Sdf.ValueTypeNames.Asset:
                continue
            times = [Usd.TimeCode.Default(), *map(Usd.TimeCode, attribute.GetTimeSamples())]
            for value in filter(None, map(attribute.Get, times)):
                yield file_of(value.resolvedPath) or value.path


def _content(path: str) -> str:
    """Return the hash of a file; the path of one that cannot be read."""
    try:
        return file_hash(path)
    except OSError:
        return path


def _version(path: str) -> str:
    """Return name, size and time [us] of a file."""
    try:
        status = os.stat(path)
    except OSError:
        return path
    return f"{os.path.basename(path)} {status.st_size} {status.st_mtime_ns // 1000}"
