"""Describe a capture or a stage in values that JSON can hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdRender

from usdsplat import schema
from usdsplat.core.axes import UP_AXIS_FRAME
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.findings import Findings
from usdsplat.core.progress import Progress, silent
from usdsplat.delegate.engine import Engine
from usdsplat.formats import Capture
from usdsplat.interchange import provenance
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.frame_guess import guess_frame
from usdsplat.interchange.unapplied import is_cropped, is_graded
from usdsplat.products.tree_summary import of_tree
from usdsplat.products.tree_views import EVERY_VIEW, ViewRequest, of_views
from usdsplat.schema.lod_roots import find_roots
from usdsplat.schema.proxy import points_of
from usdsplat.schema.stage_values import stage_unit, up_axis
from usdsplat.schema.validation import splat_fields, splat_trees
from usdsplat.sim.stage.provenance import well_typed

PERCENTILES = (1, 25, 50, 75, 99)
ROBUST = (1, 99)
"""Percentiles on each axis that bound the subject without outliers."""


def of_capture(capture: Capture) -> dict[str, Any]:
    """Describe a capture that was read, with the axes that an import would choose."""
    capture = with_axes(capture, choose_axes(capture))
    size = sum(file.stat().st_size for file in capture.files)
    return {
        "format": capture.format,
        "frame": capture.frame,
        "frame_source": capture.frame_source,
        "frame_guess": _guessed(capture),
        "meters_per_unit": capture.meters_per_unit,
        "color_space": capture.color_space,
        "rasterize_mode": "antialiased" if capture.antialiased else "classic",
        **of_cloud(capture.cloud),
        "bytes": size,
        "bytes_per_splat": size / max(1, len(capture.cloud)),
        "error_bounds": dict(capture.error_bounds),
        "notes": list(capture.notes),
    }


def _guessed(capture: Capture) -> dict[str, Any]:
    """Return the up direction guessed from the splats, and whether it agrees with the assumed
    axes."""
    guess = guess_frame(capture.cloud, capture.frame)
    wrong = f"{guess.up} looks like up, as in {guess.suggested!r}: set --axes if it is"
    return {
        "up": guess.up,
        "suggested": guess.suggested,
        "agrees": guess.agrees,
        "evidence": list(guess.evidence),
        "remark": wrong if guess.agrees is False else "",
    }


def of_stage(
    stage: Usd.Stage,
    time: float | None,
    *,
    view: ViewRequest = EVERY_VIEW,
    findings: Findings | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Describe a stage, every splat field and tree on it, and what views load of the trees.

    Fields for other renderers, of which a tree is drawn instead, are left out.

    Args:
        stage: The stage; it is not changed.
        time: Time code at which fields are read; None for the default value, or the first sample.
            Views are then at the first frame of the stage's range.
        view: View of which it is described what it loads; by default those of all cameras.
        findings: Receives what the views ask for and do not get.
        progress: Receives the progress by fields.

    Raises:
        StageError: If `view` names a camera that does not exist, or cannot be used.
        UsageError: If a value of `view` is invalid, or it has no effect.
    """
    frames = [stage.GetStartTimeCode(), stage.GetEndTimeCode()]
    roots = find_roots(stage)
    fields = [prim for prim in splat_fields(stage) if not roots.is_replaced(prim)]
    described = []
    for done, prim in enumerate(fields):
        progress.step("reading fields", done, len(fields))
        described.append(_of_field(prim, time))
    progress.step("reading fields", len(fields), len(fields))
    prims = list(stage.Traverse(Usd.TraverseInstanceProxies()))
    trees = [of_tree(prim, time) for prim in splat_trees(stage)]
    return {
        "up_axis": up_axis(stage),
        "axes": UP_AXIS_FRAME[up_axis(stage)],
        "meters_per_unit": stage_unit(stage),
        "frames": frames if stage.HasAuthoredTimeCodeRange() else None,
        "frames_per_second": stage.GetTimeCodesPerSecond(),
        "splats": sum(entry.get("splats", 0) for entry in (*described, *trees)),
        **_drawn(stage, time, view, Findings() if findings is None else findings),
        "cameras": [str(prim.GetPath()) for prim in prims if prim.IsA(UsdGeom.Camera)],
        "points": [_of_points(prim, time) for prim in points_of(prims)],
        "products": [str(prim.GetPath()) for prim in prims if prim.IsA(UsdRender.Product)],
        "fields": described,
        "trees": trees,
    }


def _drawn(
    stage: Usd.Stage, time: float | None, view: ViewRequest, findings: Findings
) -> dict[str, Any]:
    """Return what a picture contains: the numbers of its splats and surfaces, and their bounds in
    the world. A splat tree counts with the splats of its leaves. Each instance counts, hidden prims
    do not. What views load of trees follows."""
    with Engine(stage, time=time) as engine:
        scene = engine.render_scene
        bounds = scene.bounds()
        drawn = {
            "splats_drawn": scene.draw_list().total,
            "surfaces_drawn": len(scene.drawn_meshes()),
            "world_bounds": None if bounds is None else [corner.tolist() for corner in bounds],
        }
        if time is None and stage.HasAuthoredTimeCodeRange():
            engine.set_time(stage.GetStartTimeCode())
        return {**drawn, **of_views(engine, view, findings)}


def _of_field(prim: Usd.Prim, time: float | None) -> dict[str, Any]:
    """Describe one splat field, or the reason why it cannot be read."""
    identity = {"path": str(prim.GetPath()), "type": str(prim.GetTypeName())}
    try:
        cloud = schema.fetch(prim, time)
    except UsdSplatError as error:
        return {**identity, "problem": str(error)}
    samples = schema.sample_times(prim)
    numeric = [code for code in samples if code is not None]
    imageable = UsdGeom.Imageable(prim)
    size = _stored_bytes(prim, time)
    stored = prim.GetCustomDataByKey(provenance.KEY)
    origin = dict(stored) if isinstance(stored, dict) else {}
    bake = origin.pop("bake", None)
    return {
        **identity,
        "form": schema.form_of(prim),
        **_in_its_space(of_cloud(cloud)),
        "bytes_per_splat": size / max(1, len(cloud)),
        "samples": len(numeric),
        "sampled": [numeric[0], numeric[-1]] if numeric else None,
        "color_space": schema.color_space(prim),
        "rasterize_mode": schema.rasterize_mode(prim),
        "footprint": schema.footprint(prim),
        "projection_mode": schema.projection_mode(prim),
        "sorting_mode": schema.sorting_mode(prim),
        "graded": is_graded(prim, time),
        "cropped": is_cropped(prim),
        "purpose": str(imageable.ComputePurpose()),
        "provenance": _plain(origin),
        "bake": _of_bake(bake) if bake and isinstance(bake, dict) else None,
    }


def _in_its_space(described: dict[str, Any]) -> dict[str, Any]:
    """Return the description of a cloud with names that say that bounds are the field's own."""
    named = {"bounds": "local_bounds", "bounds_robust": "local_bounds_robust"}
    return {named.get(key, key): value for key, value in described.items()}


def _of_points(prim: Usd.Prim, time: float | None) -> dict[str, Any]:
    """Describe points, which are drawn as splats."""
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    found: Any = UsdGeom.Points(prim).GetPointsAttr().Get(code)
    return {
        "path": str(prim.GetPath()),
        "points": len(found) if found is not None else 0,
        "purpose": str(UsdGeom.Imageable(prim).ComputePurpose()),
    }


def _of_bake(record: dict[str, Any]) -> dict[str, Any]:
    """Describe a bake from its provenance, without the entries that only resuming needs; those that
    it lacks are None."""
    known = well_typed(record)
    span, done = known.get("frameRange"), known.get("completedFrames")
    total = None if span is None else f"{span[1] - span[0] + 1:g}"
    return {
        "mode": known.get("mode"),
        "frames": None if span is None else list(span),
        "completed": None if done is None or total is None else f"{done} of {total}",
        "resumes_from": known.get("checkpoint"),
        "substeps": known.get("substeps"),
        "seed": known.get("seed"),
        "made_by": f"usdsplat {known['solverVersion']}" if "solverVersion" in known else None,
        "inputs": [line.split("  ", 1)[-1] for line in known.get("inputHash", ())],
    }


def _stored_bytes(prim: Usd.Prim, time: float | None) -> int:
    """Return the size of a field's authored arrays at one time [byte]."""
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    values = (prim.GetAttribute(name).Get(code) for name in schema.DATA_ATTRIBUTES)
    return sum(np.asarray(value).nbytes for value in values if hasattr(value, "__len__"))


def _plain(value: Any) -> Any:
    """Return USD's dictionaries and arrays as values that JSON can hold."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def of_cloud(cloud: SplatCloud) -> dict[str, Any]:
    """Return count, degree, bounds of the centres and percentiles, in values that JSON can hold.

    Values that are not finite are counted and otherwise ignored. `bounds` contain every centre and
    `bounds_robust` those within `ROBUST` on each axis. `scale` is the geometric mean of the three
    standard deviations of a splat [scene unit], `opacity` its peak [0..1] and `anisotropy` the
    ratio of its longest to its shortest deviation, if the shortest is not 0. All are given at the
    `PERCENTILES`.
    """
    finite = cloud.positions[np.isfinite(cloud.positions).all(axis=1)]
    bounds, robust = None, None
    if len(finite):
        bounds = [finite.min(axis=0).tolist(), finite.max(axis=0).tolist()]
        robust = np.percentile(finite, ROBUST, axis=0).tolist()
    summary: dict[str, Any] = {
        "splats": len(cloud),
        "sh_degree": cloud.sh_degree,
        "bounds": bounds,
        "bounds_robust": robust,
        "scale": _percentiles(mean_scales(cloud)),
        "opacity": _percentiles(cloud.opacities),
        "anisotropy": _percentiles(anisotropies(cloud)),
        "ids": cloud.ids is not None,
        "velocities": cloud.velocities is not None,
    }
    arrays = (cloud.positions, cloud.scales, cloud.rotations, cloud.opacities, cloud.sh)
    bad = sum(int(np.count_nonzero(~np.isfinite(array))) for array in arrays)
    return {**summary, "not_finite": bad}


def mean_scales(cloud: SplatCloud) -> F64:
    """Return the geometric mean of the three standard deviations [scene unit], shape (n,)."""
    # Logarithms, because the product of three small float32 numbers may underflow.
    with np.errstate(divide="ignore", invalid="ignore"):
        means: F64 = np.exp(np.log(cloud.scales.astype(np.float64)).mean(axis=1))
    return means


def anisotropies(cloud: SplatCloud) -> F64:
    """Return the ratio of the longest to the shortest standard deviation, shape (n,). It is
    infinite or NaN if the shortest is 0."""
    scales = cloud.scales.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios: F64 = scales.max(axis=1) / scales.min(axis=1)
    return ratios


def _percentiles(values: F32 | F64) -> dict[str, float] | None:
    """Return percentile -> value; None without finite values."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {
        f"p{percent}": float(value)
        for percent, value in zip(PERCENTILES, np.percentile(values, PERCENTILES), strict=True)
    }
