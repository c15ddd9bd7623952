"""Find out whether the results of a bake are there, and are all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd

from usdsplat.core.findings import Finding, finding
from usdsplat.core.readable import readable
from usdsplat.core.wording import counted
from usdsplat.sim.stage.provenance import read_record


def bake_findings(stage: Usd.Stage) -> Iterator[Finding]:
    """Yield a finding for each missing layer of a bake, and for each bake that was interrupted."""
    for layer in stage.GetLayerStack(includeSessionLayers=False):
        record = read_record(layer)
        if record is None:
            continue
        for path in layer.subLayerPaths:
            if not _is_layer(layer, path):
                found = f"a bake without its layer {path}"
                expected = f"the file beside {layer.GetDisplayName()}"
                yield finding("no-results", "/", found, expected)
        if _is_unfinished(record):
            yield _unfinished(layer, record)


def _unfinished(layer: Sdf.Layer, record: Mapping[str, Any]) -> Finding:
    """Return the finding about an interrupted bake, whose record may be damaged."""
    found = f"{layer.GetDisplayName()}, an interrupted bake"
    if not {"frameRange", "completedFrames"} <= record.keys():
        found += " with a damaged record"
        return finding("unfinished-bake", "/", found, "completedFrames and frameRange")
    first, last = record["frameRange"]
    found += f", with {counted(record['completedFrames'], 'frame')} complete"
    return finding("unfinished-bake", "/", found, f"all frames from {first:g} to {last:g}")


def _is_layer(layer: Sdf.Layer, path: str) -> bool:
    """Return whether USD can read a sublayer."""
    try:
        return bool(Sdf.Layer.FindOrOpenRelativeToLayer(layer, path))
    except Tf.ErrorException:
        return False


def is_unfinished(path: Path) -> bool:
    """Return whether a layer is that of a bake that was interrupted.

    Raises:
        Tf.ErrorException: If it cannot be read.
    """
    if not path.is_file():
        return False
    record = read_record(Sdf.Layer.OpenAsAnonymous(readable(path), metadataOnly=True))
    return record is not None and _is_unfinished(record)


def _is_unfinished(record: Mapping[str, Any]) -> bool:
    """Return whether the record of a bake names a checkpoint, which the last frame removes."""
    return bool(record.get("checkpoint"))
