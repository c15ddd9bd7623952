"""Check a stage for everything that `usdsplat render` would stop at or complain of.

Findings of composition, fields and simulations come from the packages that read them. Those of
drawing come from the same engine and the same plans that `render` uses, at every time at which
something on the stage has a sample.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom, UsdRender, UsdShade

from usdsplat import schema
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.findings import Finding, Findings, finding, from_error
from usdsplat.core.progress import Progress, silent
from usdsplat.delegate.engine import PURPOSES, Engine
from usdsplat.delegate.product import ProductSpec
from usdsplat.delegate.scene_delegate import read_products
from usdsplat.delegate.scene_delegate.population import populate
from usdsplat.delegate.scene_delegate.unsupported import findings_on_light, findings_on_prims
from usdsplat.products.frames import first_frame, frames_to_draw
from usdsplat.products.planning import plan_default, plan_product
from usdsplat.products.preflight import findings_of, lens_findings
from usdsplat.products.preparing import files_of
from usdsplat.products.request import PicturePlan, RenderRequest
from usdsplat.schema.composition import composition_findings
from usdsplat.schema.proxy import points_of
from usdsplat.schema.validation import (
    sample_codes,
    splat_fields,
    splat_trees,
    tree_findings,
)
from usdsplat.sim.stage.collections import find_simulations
from usdsplat.sim.stage.validating import validate_simulations

MOST_TIMES = 1000
"""Largest number of times at which a stage is checked."""

ANY_FILE = "picture.exr"
"""File of a picture that the stage does not name."""

CHECKED = ("fields", "trees", "points", "surfaces", "products", "simulations")
"""Of these, a stage should have at least one."""


def check_stage(
    stage: Usd.Stage,
    findings: Findings,
    *,
    time: float | None = None,
    progress: Progress = silent,
) -> Counter[str]:
    """Check a stage.

    Args:
        stage: The stage; it is not modified.
        findings: Receives the findings.
        time: Time code to check; None for every time at which something has a sample.
        progress: Receives the progress.

    Returns:
        How much was checked: kind -> number.
    """
    findings.extend(composition_findings(stage))
    findings.extend(schema.validate(stage, time=time, progress=progress))
    findings.extend(validate_simulations(stage, time=time))
    times = [time] if time is not None else _times(stage, findings)
    with Engine(stage, device="cpu", time=times[0]) as engine:
        plans, products = _plans(engine, stage, findings)
        purposes = {purpose for plan in plans for purpose in plan.purposes}
        for done, each in enumerate(times):
            progress.step("checking frames", done, len(times))
            since = None if each == times[0] else each
            engine.set_time(each)
            engine.set_purposes(tuple(purposes | set(PURPOSES)))
            findings.extend(engine.findings, time=since)
            for plan in plans:
                drawing = findings_of(engine, plan, each)
                findings.extend(drawing if products else map(_unasked, drawing), time=since)
                findings.extend(lens_findings(engine, plan), time=since)
        progress.step("checking frames", len(times), len(times))
        looked_at = _looked_at(stage, engine, products=products, frames=len(times))
    if not any(looked_at[kind] for kind in CHECKED):
        expected = "a splat field, a tree, points, a surface, a product or a simulation"
        findings.add(finding("nothing-checked", "/", "nothing to check", expected))
    return looked_at


def opening_findings(stage: Usd.Stage, time: float | None) -> Iterator[Finding]:
    """Yield what a stage asks for and does not get when it is opened at a time; None: its first."""
    yield from composition_findings(stage)
    yield from tree_findings(stage)
    first = first_frame(stage, None) if time is None else time
    with Engine(stage, device="cpu", time=first) as engine:
        yield from engine.findings


def prim_findings(stage: Usd.Stage, time: float | None) -> list[Finding]:
    """Return what prims ask for and do not get at a time, as far as it costs no splat data: unknown
    names and types, lights, members of crops. Values, materials and textures are not read."""
    code = Usd.TimeCode(first_frame(stage, None) if time is None else time)
    known = populate(stage)
    found = [
        *known.findings,
        *findings_on_prims(known.others, code, frozenset(PURPOSES)),
    ]
    for prim in known.lights.values():
        if UsdGeom.Imageable(prim).ComputeVisibility(code) != UsdGeom.Tokens.invisible:
            found += findings_on_light(prim)
    for entry in known.fields.values():
        found += entry.crop.findings
    return sorted(found, key=lambda each: (each.path, each.message))


def _plans(engine: Engine, stage: Usd.Stage, findings: Findings) -> tuple[list[PicturePlan], int]:
    """Return a plan of each product, or of the picture of a stage without products, and the number
    of products."""
    plans: list[PicturePlan] = []
    seen = set()
    for prim in stage.Traverse():
        if prim.IsA(UsdRender.Settings) or prim.IsA(UsdRender.Pass):
            named: list[PicturePlan] = []
            for spec in _products(engine, stage, str(prim.GetPath()), findings):
                seen.add(spec.path)
                findings.extend(spec.findings)
                try:
                    plans.append(_plan(engine, spec, findings))
                except UsdSplatError as error:
                    findings.add(from_error("bad-product", error))
                else:
                    named += plans[-1:] if spec.names else []
            try:
                files_of(named, frames_to_draw(stage, None, named))
            except UsdSplatError as error:
                findings.add(from_error("bad-product", error))
    if not seen:
        plans.append(plan_default(engine, RenderRequest(output=ANY_FILE)))
    return list(dict.fromkeys(plans)), len(seen)


def _products(
    engine: Engine, stage: Usd.Stage, settings: str, findings: Findings
) -> Iterator[ProductSpec]:
    """Yield the products of a RenderSettings prim or a RenderPass that can be read."""
    try:
        for spec in read_products(stage, time=engine.time, settings_path=settings):
            if isinstance(spec, StageError):
                findings.add(from_error("bad-product", spec))
            else:
                yield spec
    except UsdSplatError as error:
        findings.add(from_error("bad-settings", error))


def _unasked(found: Finding) -> Finding:
    """Return a finding on a picture that a stage does not ask for: an empty one is no error."""
    is_empty = found.code == "nothing-to-draw"
    return replace(found, severity="warning") if is_empty else found


def _plan(engine: Engine, spec: ProductSpec, findings: Findings) -> PicturePlan:
    """Return the plan of a product.

    Raises:
        UsdSplatError: If it cannot be drawn as authored.
    """
    if not spec.names:
        wrong = finding("bad-product", spec.path, "no productName", "a file, or render with -o")
        findings.add(replace(wrong, severity="warning"))
    plan = plan_product(engine, RenderRequest(output=None if spec.names else ANY_FILE), spec)
    findings.extend(plan.findings)
    return plan


def _times(stage: Usd.Stage, findings: Findings) -> list[float]:
    """Return the first and last frame, and every time at which something has a sample; of too many
    some, evenly spaced, with the first and the last."""
    first = first_frame(stage, None)
    times = {stage.GetEndTimeCode()} if stage.HasAuthoredTimeCodeRange() else set()
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        for attribute in prim.GetAuthoredAttributes():
            if attribute.ValueMightBeTimeVarying():
                times.update(attribute.GetTimeSamples())
    found = [first, *sorted(times - {first})]
    if len(found) <= MOST_TIMES:
        return found
    expected = f"at most {MOST_TIMES}, so that as many are checked, evenly spaced"
    findings.add(finding("not-checked", "/", f"{len(found)} times with samples", expected))
    rows = np.linspace(0, len(found) - 1, MOST_TIMES).round().astype(int)
    return [found[row] for row in rows]


def _looked_at(stage: Usd.Stage, engine: Engine, *, products: int, frames: int) -> Counter[str]:
    """Return the number of things of each kind on a stage."""
    prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    fields = list(splat_fields(stage))
    shaders = [UsdShade.Shader(prim) for prim in prims if prim.IsA(UsdShade.Shader)]
    return Counter(
        layers=len(stage.GetUsedLayers()),
        prims=len(prims),
        fields=len(fields),
        trees=sum(1 for _ in splat_trees(stage)),
        points=len(points_of(prims)),
        samples=sum(len(sample_codes(prim)) for prim in fields),
        surfaces=len(engine.meshes()),
        materials=sum(prim.IsA(UsdShade.Material) for prim in prims),
        textures=sum(shader.GetShaderId() == "UsdUVTexture" for shader in shaders),
        cameras=len(engine.cameras()),
        products=products,
        simulations=len(find_simulations(stage)),
        frames=frames,
    )
