"""Compute the colours of splats under the lights of a stage, and write them to a layer over it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdLux

from usdsplat import schema
from usdsplat.core.errors import FormatError, StageError, UsageError
from usdsplat.core.findings import Finding, Findings, finding
from usdsplat.core.progress import Progress, silent
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate.unsupported import LIGHTS
from usdsplat.images.texture import read_texture
from usdsplat.interchange.over_layer import save_over
from usdsplat.kernels.device import Device
from usdsplat.products.remarks import estimated_light
from usdsplat.render.lights.captured import estimate
from usdsplat.render.lights.relighting import field_gains, fit_colors
from usdsplat.render.settings import RenderSettings

PHOTOGRAPHED = "SplatCapturedLight"
"""Name of the dome with the HDRI of the set below a field, on a layer that is not saved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RelightRequest:
    """What to relight, and out of which light."""

    prims: tuple[str, ...] = ()
    """Paths of fields, or of prims above them; empty for all."""
    captured_hdri: Path | None = None
    """Latlong picture of the light in which fields without named lights were photographed, in the
    space of each field."""
    time: float | None = None
    """Time code at which fields that do not change are lit; None is the stage's first frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldRelight:
    """Result for one field: those of the sample with the largest errors."""

    path: str
    splats: int
    """Splats of the largest sample."""
    samples: int
    """Number of time samples; 0 for a field that does not change."""
    error: float
    """Root mean square of the difference to the exact colours in all directions, in the colour
    space of the field."""
    worst: float
    """Largest difference."""
    residual: float | None
    """Part of the variation of colours that the estimated light of the photographs does not
    explain, [0..1]; None if this light is named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RelightReport:
    """Result of a layer of relit colours."""

    target: str
    fields: tuple[FieldRelight, ...]


def write_relit(
    stage: Usd.Stage,
    target: Path,
    device: Device,
    settings: RenderSettings,
    request: RelightRequest,
    *,
    progress: Progress = silent,
    findings: Findings,
) -> RelightReport:
    """Relight the splat fields of a stage, and write their colours to a layer over the stage.

    A field whose arrays have time samples gets the same samples; others are lit once. Samples at
    which a field is hidden keep their colours. The layer says that the fields are to be drawn as
    captured, so that they are not lit again.

    Args:
        stage: The stage; its layers are not changed.
        target: File to write, .usda, .usdc or .usd.
        device: Runs the kernels.
        settings: Those of light count; the mode is relit.
        request: What to relight.
        progress: Receives the number of finished samples.
        findings: Receives what is not as the stage asks for at all samples, and fields that are
            not relit.

    Raises:
        StageError: If the stage has no visible light, or no field can be relit.
        UsageError: If the captured HDRI cannot be read.
        StrictError: If findings are strict, and there are some.
        OutputError: If the target cannot be written.
    """
    settings = replace(settings, lighting="relit")
    scratch = Usd.Stage.Open(Sdf.Layer.CreateAnonymous("relit.usda"))
    found: dict[str, FieldRelight] = {}
    unlit: list[tuple[str, float | None]] = []
    has_lights = False
    time: Any = "first" if request.time is None else request.time
    with (
        _photographed_in(stage, request.captured_hdri),
        Engine(stage, time=time, device="cpu") as engine,
    ):
        wanted = _wanted(stage, request.prims, findings)
        work = _work(stage, wanted, engine.time)
        for done, (at, samples) in enumerate(work.items()):
            progress.step("relight", done, len(work))
            engine.set_time(at)
            engine.sync()
            findings.extend(map(_of_picture, engine.findings), time=at if done else None)
            findings.check()
            scene = engine.render_scene
            has_lights |= bool(scene.lights)
            gains = field_gains(device, scene, settings.resolved(()))
            fields = {path: field for path, field, _ in scene.drawn()}
            for path, sample in samples:
                if path not in gains:
                    unlit.append((path, sample))
                    continue
                prim, spec = stage.GetPrimAtPath(path), fields[path].spec
                fitted = fit_colors(spec.cloud.sh, gains[path], spec.color_space)
                cloud = replace(spec.cloud, sh=fitted.sh)
                schema.author_radiance(scratch, prim, cloud, time=sample)
                residual = None
                if not any(scene.light(each) for each in spec.captured_lights):
                    findings.add(estimated_light(path))
                    surface = fields[path].surface_values(None)
                    residual = estimate(spec.cloud, spec.color_space, surface).residual
                own = FieldRelight(
                    path=path, splats=len(cloud), samples=0 if sample is None else 1,
                    error=fitted.error, worst=fitted.worst, residual=residual,
                )  # fmt: skip
                found[path] = _merged(found[path], own) if path in found else own
        progress.step("relight", len(work), len(work))
    if not has_lights:
        raise StageError("lights", "none that is visible", "a light to relight by")
    for path, sample in unlit:
        prim = stage.GetPrimAtPath(path)
        if path not in found:
            findings.add(_why_not(prim))
            continue
        with suppress(StageError):  # a sample that cannot be read is a finding of the engine
            schema.author_radiance(scratch, prim, schema.fetch(prim, sample), time=sample)
    if not found:
        raise StageError("fields", "none that can be relit", "a visible splat field")
    findings.check()
    for path in found:
        schema.author_captured(scratch, path)
    save_over(scratch.GetRootLayer(), stage, target)
    return RelightReport(target=str(target), fields=tuple(found[path] for path in sorted(found)))


def _work(
    stage: Usd.Stage, paths: list[str], still: float | None
) -> dict[float | None, list[tuple[str, float | None]]]:
    """Return, for each time at which the stage is lit, the fields and the times to author at.

    Args:
        still: Time at which fields that do not change are lit; their time to author at is None.
    """
    found: dict[float | None, list[tuple[str, float | None]]] = {}
    for path in paths:
        times: Sequence[float | None] = schema.sample_times(stage.GetPrimAtPath(path))
        for each in times or [None]:
            found.setdefault(still if each is None else each, []).append((path, each))
    return found


def _merged(a: FieldRelight, b: FieldRelight) -> FieldRelight:
    """Return the result of two samples of a field."""
    residuals = [each.residual for each in (a, b) if each.residual is not None]
    return FieldRelight(
        path=a.path, splats=max(a.splats, b.splats), samples=a.samples + b.samples,
        error=max(a.error, b.error), worst=max(a.worst, b.worst),
        residual=max(residuals) if residuals else None,
    )  # fmt: skip


def _wanted(stage: Usd.Stage, prims: tuple[str, ...], findings: Findings) -> list[str]:
    """Return the paths of the fields to relight; others that were asked for are findings."""
    found = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        path = str(prim.GetPath())
        if not (schema.is_splat_field(prim) or schema.is_tree(prim)):
            continue
        if prims and not any(_is_beneath(path, each) for each in prims):
            continue
        if schema.is_tree(prim) or prim.IsInstanceProxy():
            findings.add(_why_not(prim))
        else:
            found.append(path)
    if not found:
        raise StageError("fields", "none that can be relit", "a visible splat field")
    return found


def _why_not(prim: Usd.Prim) -> Finding:
    """Return the finding on a prim that is not relit."""
    path, expected = str(prim.GetPath()), "a visible field that is drawn once"
    if schema.is_tree(prim):
        return finding("not-relit", path, "a splat tree", expected)
    if schema.lighting_mode(prim) == "captured":
        where = f"{path}.{schema.tokens.LIGHTING}"
        return finding("not-relit", where, "'captured'", "'auto' or 'relit'")
    return finding("not-relit", path, "a field that is hidden, empty or instanced", expected)


def _is_beneath(path: str, prim: str) -> bool:
    return path == prim or path.startswith(prim.rstrip("/") + "/")


@contextmanager
def _photographed_in(stage: Usd.Stage, picture: Path | None) -> Iterator[None]:
    """Name hidden domes with a picture as the light of all photographs, while the stage is relit.

    Each field has its own dome, which is below it: the set turns with the capture.
    """
    if picture is None:
        yield
        return
    layer = Sdf.Layer.CreateAnonymous("captured.usda")
    session = stage.GetSessionLayer()
    session.subLayerPaths.insert(0, layer.identifier)
    try:
        with Usd.EditContext(stage, layer):
            fields = [
                prim for prim in stage.Traverse()
                if schema.is_splat_field(prim) and not _names_light(prim)
            ]  # fmt: skip
            if not fields:
                _check_picture(picture)
            for prim in fields:
                path = prim.GetPath().AppendChild(PHOTOGRAPHED)
                dome = UsdLux.DomeLight_1.Define(stage, path)
                dome.CreateTextureFileAttr(str(picture.resolve()))
                dome.MakeInvisible()
                names = prim.CreateRelationship(schema.tokens.CAPTURED_LIGHTS, custom=False)
                names.SetTargets([path])
        yield
    finally:
        session.subLayerPaths.remove(layer.identifier)


def _names_light(field: Usd.Prim) -> bool:
    """Return whether a field names a light of its photographs that is on the stage."""
    named = map(field.GetStage().GetPrimAtPath, schema.captured_lights(field))
    return any(each and each.IsA(kind) for each in named for kind in LIGHTS)


def _check_picture(picture: Path) -> None:
    """Raise an error for a picture that cannot be read, although no field needs it.

    Raises:
        UsageError: If it is not there, or no picture.
    """
    try:
        read_texture(picture)
    except FormatError as error:
        raise UsageError("--captured-hdri", str(picture), error.expected) from None


def _of_picture(found: Finding) -> Finding:
    """Return a finding; one on a dome of the picture names the flag in place of the dome.

    Raises:
        UsageError: If the picture cannot be read.
    """
    above, _, name = found.path.rpartition("/")
    if name != PHOTOGRAPHED:
        return found
    if not found.attribute.startswith("inputs:texture"):
        return replace(found, path=above, attribute="")
    if found.code == "bad-light":
        raise UsageError("--captured-hdri", found.found, found.expected)
    return replace(found, path="--captured-hdri", attribute="")
