"""The files of a bake.

    bake.usda               the file that the user names: small, over the capture's stage
    bake_data/clip.0000.usdc, ...   samples, a file for each epoch
    bake_data/clips.usda    the clips as one layer of opinions
    bake_data/manifest.usda which attributes are in the clips
    bake_data/samples.usdc  all samples; written at the end, except in mode clips
    bake_data/kept_checkpoint   state at the first frame of the last epoch, to add frames from
    bake_data/refined.usdc  the refined captures, below the samples; only if there are some
    bake_data/checkpoint, bake_data/*.frame     state to resume from; removed at the end

Except in mode clips, `samples.usdc` replaces `clip.*`, `clips.usda` and `manifest.usda`.

Files under these names are always complete, see `core/output`. The named layer is put in place
last, so that everything it refers to exists. A simulation that fails leaves the frames, clips and
checkpoint that `--resume` needs, and nothing if it has no checkpoint yet. One that is killed leaves
more; its named layer states how many frames are complete, and `bake_findings` reports it. `--force`
removes an earlier bake when it starts.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd, UsdGeom, Vt

from usdsplat.core.errors import FormatError, OutputError, StageError
from usdsplat.core.output import output_group
from usdsplat.core.readable import check_referable, readable
from usdsplat.schema import tokens
from usdsplat.schema.usd_files import export_layer
from usdsplat.schema.value_clips import stage_files
from usdsplat.sim.checkpoint import time_of
from usdsplat.sim.stage import refined_layer
from usdsplat.sim.stage.bake_findings import is_unfinished
from usdsplat.sim.stage.plan import Plan
from usdsplat.sim.stage.provenance import nested
from usdsplat.sim.stage.sample_layer import Part, declare, merge, sampled

_CLIPS = ("clip.*.usdc", "clips.usda", "manifest.usda")
_WORK = ("checkpoint", "*.frame")
_KEPT = "kept_checkpoint"
REFINED = "refined.usdc"
_DATA = ("samples.usdc", REFINED)


class BakeLayers:
    """Writer of the files of a bake."""

    def __init__(self, stage: Usd.Stage, target: Path, plans: Sequence[Plan]) -> None:
        self.target = target
        self.folder = target.with_name(f"{target.stem}_data")
        self._stage = stage
        self._plans = plans
        self.rate = float(stage.GetTimeCodesPerSecond())
        self._refined = refined_layer.find(stage)
        self._check()

    @property
    def checkpoint(self) -> Path:
        """Path of the checkpoint, whether it exists or not."""
        return self.folder / "checkpoint"

    @property
    def kept(self) -> Path:
        """Path of the checkpoint from which frames can be added, whether it exists or not."""
        return self.folder / _KEPT

    @property
    def merged(self) -> Path:
        """Path of the file of all samples, whether it exists or not."""
        return self.folder / "samples.usdc"

    @property
    def refined(self) -> Path:
        """Path of the refined captures, whether there are some or not."""
        return self.folder / REFINED

    def clip(self, number: int) -> Path:
        """Return the file of an epoch."""
        return self.folder / f"clip.{number:04d}.usdc"

    def begin(self) -> None:
        """Make an empty folder; files of an older bake are removed."""
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            found = error.strerror or str(error)
            raise OutputError(str(self.folder), found, "a folder that can be made") from error
        self._remove((*_CLIPS, *_WORK, _KEPT, *_DATA))
        if self._refined is not None:
            export_layer(self._refined, self.refined)

    def end(self, *, keeps_clips: bool, keeps_checkpoint: bool = True) -> None:
        """Remove everything that the named layer does not need."""
        self._remove(_WORK if keeps_clips else (*_CLIPS, *_WORK))
        if not keeps_checkpoint:
            self._remove((_KEPT,))

    def discard(self) -> None:
        """Remove an unfinished named layer and the folder. Complete ones stay: then only the error
        was late, for example of synchronising with the disk. So does a named layer of an earlier
        bake that this one has not replaced."""
        try:
            is_ours = is_unfinished(self.target)
        except (OSError, Tf.ErrorException):
            is_ours = False  # damaged by another program: what a bake puts in place is complete
        data = [self.folder / name for name in ("samples.usdc", "clips.usda")]
        if not is_ours and any(map(os.path.exists, data)):
            with suppress(OSError):
                self.end(keeps_clips=not os.path.exists(data[0]))
            return
        with suppress(OSError):
            self._remove((*_CLIPS, *_WORK, _KEPT, *_DATA))
            self.folder.rmdir()
        if is_ours:
            with suppress(OSError):
                self.target.unlink()

    def show_clips(self, spans: Sequence[tuple[float, float]], record: Mapping[str, Any]) -> None:
        """Write the named layer over the finished clips.

        Args:
            spans: First and last time of each clip [time code].
            record: As `Provenance.record` returns it.
        """
        if not spans:
            self._write_root([], record)
            return
        layer, manifest = _new(self.rate), _new(self.rate)
        clip = Sdf.Layer.OpenAsAnonymous(str(self.clip(0)))  # all clips have the same attributes
        declare(clip, layer)
        for path in sampled(clip):
            spec = clip.GetAttributeAtPath(path)
            owner = Sdf.CreatePrimInLayer(manifest, path.GetPrimPath())
            Sdf.AttributeSpec(owner, spec.name, spec.typeName, spec.variability)
        names = [f"./{self.clip(number).name}" for number in range(len(spans))]
        stops = sorted({float(time) for span in spans for time in span})
        owners = [path for plan in self._plans for path in (plan.path, plan.proxy) if path]
        for path in owners:
            clips = {
                "primPath": path,
                "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(name) for name in names]),
                "manifestAssetPath": Sdf.AssetPath("./manifest.usda"),
                "active": Vt.Vec2dArray([(span[0], i) for i, span in enumerate(spans)]),
                "times": Vt.Vec2dArray([(time, time) for time in stops]),
            }
            Sdf.CreatePrimInLayer(layer, path).SetInfo("clips", {"default": clips})
        with output_group():
            export_layer(manifest, self.folder / "manifest.usda")
            export_layer(layer, self.folder / "clips.usda")
            self._write_root([self.folder / "clips.usda"], record)

    def show_earlier(self, record: Mapping[str, Any], *, has_clips: bool) -> None:
        """Write the named layer over the results of a bake that frames are added to."""
        self._write_root([self.folder / "clips.usda" if has_clips else self.merged], record)

    def show_merged(self, parts: Sequence[Part], record: Mapping[str, Any]) -> None:
        """Write the named layer over one file of the samples of all parts."""
        # At the default time, the arrays of the packed type have no value. Positions must not have
        # one either, or the prim would be inconsistent there.
        retyped = [f"{plan.path}.{tokens.POSITIONS}" for plan in self._plans if plan.retype]
        with output_group():
            merge(parts, self.merged, self.rate, retyped)
            self._write_root([self.merged], record)

    def _remove(self, patterns: Sequence[str]) -> None:
        """Remove files of a bake."""
        for pattern in patterns:
            for path in self.folder.glob(pattern):
                path.unlink()

    def _write_root(self, results: Sequence[Path], record: Mapping[str, Any]) -> None:
        """Write the layer that the user opens."""
        source = self._stage.GetRootLayer()
        root = _new(self.rate)
        for key in sorted(source.pseudoRoot.ListInfoKeys()):
            if key not in ("subLayers", "subLayerOffsets", "specifier"):
                root.pseudoRoot.SetInfo(key, source.pseudoRoot.GetInfo(key))
        root.timeCodesPerSecond = self.rate
        if any(plan.is_packed for plan in self._plans):
            known = dict(root.pseudoRoot.GetInfo("fallbackPrimTypes") or {})
            known[tokens.PACKED_TYPE] = Vt.TokenArray([tokens.BASE_TYPE])
            root.pseudoRoot.SetInfo("fallbackPrimTypes", known)
        first, last = record["frameRange"]
        root.startTimeCode = min(first, source.startTimeCode) if _has_range(source) else first
        root.endTimeCode = max(last, source.endTimeCode) if _has_range(source) else last
        captures = [source.realPath] if self._refined is None else [self.refined, source.realPath]
        root.subLayerPaths = [self._relative(path) for path in (*results, *captures)]
        root.customLayerData = {**source.customLayerData, **nested(record)}
        for plan in self._plans:
            mine = nested({**record, "epsilon": plan.epsilon})
            Sdf.CreatePrimInLayer(root, plan.path).customData = mine
            if plan.moves or self._refined is not None:
                _block_hints(root, self._stage.GetPrimAtPath(plan.path))
        export_layer(root, self.target)

    def _relative(self, path: Path | str) -> str:
        """Return a path relative to the named layer."""
        relative = Path(os.path.relpath(path, self.target.parent)).as_posix()
        return relative if relative.startswith("../") else f"./{relative}"

    def _check(self) -> None:
        """Reject targets that would harm the input or cannot be referred to."""
        root = self._stage.GetRootLayer()
        if root.anonymous or not root.realPath:
            raise StageError(root.identifier, "a stage without a file", "a saved one")
        for path in (root.realPath, self.folder):
            check_referable(path, self.target.parent)
        used = map(Path, stage_files(self._stage))
        if self.target.resolve() in {path.resolve() for path in used}:
            raise StageError(str(self.target), "a file of the stage itself", "another name")
        if not self.target.parent.is_dir():
            found = os.strerror(errno.ENOENT)
            raise OutputError(str(self.folder), found, "a folder that can be made")
        if self.target.suffix != ".usda":
            raise StageError(str(self.target), f"the suffix {self.target.suffix!r}", ".usda")


def resume_frame(target: Path) -> float | None:
    """Return the frame after which an interrupted bake can be continued; None before its first
    checkpoint."""
    folder = target.with_name(f"{target.stem}_data")
    names = ["checkpoint"]
    try:
        names += [_KEPT] if is_unfinished(target) else []
        for name in names:
            if (folder / name).is_file():
                return time_of(folder / name)
    except (OSError, Tf.ErrorException, FormatError):
        pass  # damaged, or another program's
    return None


def refined_of(target: Path) -> Sdf.Layer | None:
    """Return the refined captures of the bake at a path, in memory; None without some.

    Raises:
        FormatError: If they are damaged.
    """
    path = target.with_name(f"{target.stem}_data") / REFINED
    if not (target.exists() and path.exists()):
        return None
    try:
        return Sdf.Layer.OpenAsAnonymous(readable(path))
    except (RuntimeError, Tf.ErrorException) as error:
        raise FormatError(str(path), "a damaged file", "the layer of refined captures") from error


def _block_hints(root: Sdf.Layer, prim: Usd.Prim) -> None:
    """Block authored bounds of the models above a moving field: they are those of the capture."""
    while prim := prim.GetParent():
        attribute = prim.GetAttribute(UsdGeom.Tokens.extentsHint)
        if attribute and attribute.HasAuthoredValue():
            owner = Sdf.CreatePrimInLayer(root, prim.GetPath())
            spec = Sdf.AttributeSpec(owner, attribute.GetName(), attribute.GetTypeName())
            spec.default = Sdf.ValueBlock()


def _new(rate: float) -> Sdf.Layer:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.timeCodesPerSecond = rate
    return layer


def _has_range(layer: Sdf.Layer) -> bool:
    return bool(layer.HasStartTimeCode() and layer.HasEndTimeCode())
