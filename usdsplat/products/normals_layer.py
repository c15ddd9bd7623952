"""Author the normals, confidence and occlusion of the splats of a stage in a layer over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, Findings, finding
from usdsplat.core.progress import Progress, silent
from usdsplat.core.sh import dc_to_rgb
from usdsplat.interchange.over_layer import save_over
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.surface_normals import SurfaceNormals, surface_normals
from usdsplat.schema.lod_roots import find_roots

_NO_TREE = "a splat field; lights make the normals of a tree themselves"


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldNormals:
    """Result for one field. Medians are those of the first sample; 0 without splats."""

    path: str
    splats: int
    """Splats of the largest sample."""
    samples: int
    """Number of time samples; 0 for a field that does not change."""
    confidence: float
    """Median, [0..1]."""
    occlusion: float
    """Median, [0..1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalsReport:
    """Result of a layer of normals."""

    target: str
    fields: tuple[FieldNormals, ...]


def write_normals(
    stage: Usd.Stage,
    target: Path,
    device: Device,
    *,
    prims: tuple[str, ...] = (),
    progress: Progress = silent,
    findings: Findings,
) -> NormalsReport:
    """Compute the normals of all splat fields, and write them to a layer over the stage.

    Fields are computed one by one, so that splats of other fields hide no sky. A field whose arrays
    have time samples gets the same samples.

    Args:
        stage: The stage; its layers are not changed.
        target: File to write, .usda, .usdc or .usd.
        device: Runs the kernels.
        prims: Paths of fields, or of prims above them; empty for all.
        progress: Receives the number of finished samples.
        findings: Receives fields that get no normals.

    Raises:
        StageError: If there is no field, none at or below one of `prims`, or one cannot be read.
        StrictError: If findings are strict, and a field gets no normals.
        OutputError: If the target cannot be written.
    """
    fields, left_out = _fields(stage, prims)
    findings.extend(left_out)
    findings.check()
    work = [(prim, time) for prim in fields for time in _times(prim)]
    opinions = Sdf.Layer.CreateAnonymous("normals.usda")
    scratch = Usd.Stage.Open(opinions)
    found: dict[str, FieldNormals] = {}
    for done, (prim, time) in enumerate(work):
        progress.step("normals", done, len(work))
        cloud = schema.fetch(prim, time)
        normals = normals_of(device, cloud)
        schema.author_surface(
            scratch.OverridePrim(prim.GetPath()),
            normals=normals.normals,
            confidence=normals.confidence,
            occlusion=normals.occlusion,
            time=time,
        )
        path = str(prim.GetPath())
        found[path] = _summary(path, found.get(path), normals, time)
    progress.step("normals", len(work), len(work))
    save_over(opinions, stage, target)
    return NormalsReport(target=str(target), fields=tuple(found.values()))


def _times(prim: Usd.Prim) -> Sequence[float | None]:
    """Return the times to author at; None stands for the default values."""
    return schema.sample_times(prim) or [None]


def normals_of(device: Device, cloud: SplatCloud) -> SurfaceNormals:
    """Return the normals of a cloud, see `surface_normals`."""
    colors = dc_to_rgb(cloud.sh[:, 0])
    arrays = cloud.positions, cloud.rotations, cloud.scales, cloud.opacities
    return surface_normals(device, *arrays, colors)


def _summary(
    path: str, before: FieldNormals | None, found: SurfaceNormals, time: float | None
) -> FieldNormals:
    """Return the result of a field after a further sample."""
    count = len(found.normals)
    if before is not None:
        return FieldNormals(
            path=path,
            splats=max(before.splats, count),
            samples=before.samples + 1,
            confidence=before.confidence,
            occlusion=before.occlusion,
        )
    return FieldNormals(
        path=path,
        splats=count,
        samples=0 if time is None else 1,
        confidence=float(np.median(found.confidence)) if count else 0.0,
        occlusion=float(np.median(found.occlusion)) if count else 0.0,
    )


def _fields(stage: Usd.Stage, prims: tuple[str, ...]) -> tuple[list[Usd.Prim], list[Finding]]:
    """Return the fields to author on, and findings on those that have no normals, but not on fields
    for other renderers, of which a splat tree is drawn instead."""
    found, findings, paths, roots = [], [], [], find_roots(stage)
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        path, is_tree = str(prim.GetPath()), schema.is_tree(prim)
        if not (is_tree or schema.is_splat_field(prim)) or roots.is_replaced(prim):
            continue
        paths.append(path)
        if prims and not any(_is_beneath(path, each) for each in prims):
            continue
        if is_tree:
            findings.append(finding("no-normals", path, "a splat tree", _NO_TREE))
        elif prim.IsInstanceProxy():
            expected = "one that a layer can change"
            findings.append(finding("no-normals", path, "a field in an instance", expected))
        else:
            found.append(prim)
    for each in prims:
        if not any(_is_beneath(path, each) for path in paths):
            raise StageError("--prim", each, f"a field: {', '.join(paths) or 'none'}")
    if paths and all(schema.is_tree(stage.GetPrimAtPath(path)) for path in paths):
        raise StageError("fields", f"splat trees only ({', '.join(paths)})", _NO_TREE)
    if not found:
        what = f"none that a layer can change ({', '.join(paths) or 'no field at all'})"
        raise StageError("fields", what, "a splat field outside of instances")
    return found, findings


def _is_beneath(path: str, prim: str) -> bool:
    return path == prim or path.startswith(prim.rstrip("/") + "/")
