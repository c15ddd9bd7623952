"""Compute the colours of splats under the lights of a stage, and write them to a layer over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, Findings, finding
from usdsplat.core.folders import made_folder
from usdsplat.core.part import Part
from usdsplat.core.progress import Progress, silent
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate.stage_info import first_frame
from usdsplat.interchange.over_layer import save_over
from usdsplat.kernels.device import Device
from usdsplat.products.captured_hdri import of_picture, photographed_in
from usdsplat.products.lit_times import LitField, LitFolder, LitTime, stamp_of
from usdsplat.products.remarks import estimated_light, few_light_samples
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights.captured import estimate
from usdsplat.render.lights.relighting import field_gains, fit_colors
from usdsplat.render.settings import RenderSettings
from usdsplat.schema.lod_roots import find_roots

MOST_NAMED = 3
"""Number of fields that a sentence on a wrong path names."""


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


class Relighting:
    """The work of relighting the splat fields of a stage: the times at which it is lit.

    A field whose arrays have time samples is lit at these; others are lit once.

    Args:
        stage: The stage; its layers are not changed.
        settings: Those of light count; the mode is relit.
        request: What to relight.
        device: Opens the device, which runs the kernels, when there is something to light.
        findings: Receives what is not as the stage asks for at all samples, and fields that are
            not relit.

    Raises:
        StageError: If there is no field to relight, or none at or below one of `request.prims`.
        StrictError: If findings are strict, and there are some.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        settings: RenderSettings,
        request: RelightRequest,
        device: Callable[[], Device],
        *,
        findings: Findings,
    ) -> None:
        self._stage, self._request, self._findings = stage, request, findings
        self._settings = replace(settings, lighting="relit")
        self._device = device
        wanted = _wanted(stage, request.prims, findings)
        findings.check()
        self._still = first_frame(stage) if request.time is None else request.time
        self._work = list(_work(stage, wanted, self._still).items())
        self._said = 0
        """Number of times whose findings `say` has said."""

    def __len__(self) -> int:
        """Return the number of times at which the stage is lit."""
        return len(self._work)

    def folder(self, target: Path, device: str) -> LitFolder:
        """Return the folder in which parts of the work wait for the layer to be written.

        Args:
            target: The layer.
            device: Name of the device.
        """
        asked = replace(self._request, captured_hdri=None)
        values = (asked, self._settings)
        stamp = stamp_of(self._stage, device, values, self._request.captured_hdri)
        return LitFolder(target, stamp)

    def light(self, part: Part, folder: LitFolder, *, progress: Progress = silent) -> int:
        """Light a part of the times, store the results, and return their number.

        Those that are there already are kept.

        Raises:
            UsageError: If the captured HDRI cannot be read.
            StrictError: If findings are strict, and there are some.
            OutputError: If a file cannot be written.
        """
        numbers = part.of(len(self))
        with made_folder(folder.path), self._lighter() as lighter:
            for done, number in enumerate(numbers):
                progress.step("relight", done, len(numbers))
                lit = folder.load(number)
                if lit is None:
                    lit = lighter.light(number, self._say)
                    folder.save(number, lit)
                else:
                    self._say(number, lit.findings)
                self._say_estimated(lit)
            progress.step("relight", len(numbers), len(numbers))
        return len(numbers)

    def say(self, folder: LitFolder) -> None:
        """Say the findings of the first times that others have lit, as one process does.

        Raises:
            StrictError: If findings are strict, and there are some.
        """
        while self._said < len(self) and (lit := folder.load(self._said)) is not None:
            self._say(self._said, lit.findings)
            self._say_estimated(lit)
            self._said += 1

    def write(
        self, target: Path, folder: LitFolder | None = None, *, progress: Progress = silent
    ) -> RelightReport:
        """Write the colours of the fields to a layer over the stage.

        Samples at which a field is hidden keep their colours. The layer says that the fields are to
        be drawn as captured, so that they are not lit again.

        Args:
            target: File to write, .usda, .usdc or .usd.
            folder: Has times that are lit already; None for none. It is removed at the end.
            progress: Receives the number of finished times.

        Raises:
            StageError: If the stage has no visible light, or no field can be relit.
            UsageError: If the captured HDRI cannot be read.
            StrictError: If findings are strict, and there are some.
            OutputError: If the target cannot be written.
        """
        stage, findings = self._stage, self._findings
        scratch = Usd.Stage.Open(Sdf.Layer.CreateAnonymous("relit.usda"))
        found: dict[str, FieldRelight] = {}
        unlit: list[tuple[str, float | None]] = []
        has_lights = False
        with self._lighter() as lighter:
            for number, (_, samples) in enumerate(self._work):
                progress.step("relight", number, len(self))
                lit = None if folder is None else folder.load(number)
                if lit is None:
                    lit = lighter.light(number, self._say)
                else:
                    self._say(number, lit.findings)
                self._say_estimated(lit)
                has_lights |= lit.has_lights
                for path, sample in samples:
                    if path not in lit.fields:
                        unlit.append((path, sample))
                        continue
                    each = lit.fields[path]
                    schema.author_radiance(
                        scratch, stage.GetPrimAtPath(path), each.cloud, time=sample
                    )
                    own = FieldRelight(
                        path=path, splats=len(each.cloud), samples=0 if sample is None else 1,
                        error=each.error, worst=each.worst, residual=each.residual,
                    )  # fmt: skip
                    found[path] = _merged(found[path], own) if path in found else own
            progress.step("relight", len(self), len(self))
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
        if folder is not None:
            folder.remove()
        fields = tuple(found[path] for path in sorted(found))
        return RelightReport(target=str(target), fields=fields)

    # --- private ---------------------------------------------------------------------------

    def _lighter(self) -> _Lighter:
        return _Lighter(
            self._stage, self._work, self._settings, self._request, self._device, self._still
        )

    def _say(self, number: int, found: Sequence[Finding]) -> None:
        """Say the findings of a time. Those of the first one have no time."""
        self._findings.extend(found, time=self._work[number][0] if number else None)
        self._findings.check()

    def _say_estimated(self, lit: LitTime) -> None:
        """Say which fields have no named light."""
        for path, each in lit.fields.items():
            if each.residual is not None:
                self._findings.add(estimated_light(path))


_Work = list[tuple[float | None, list[tuple[str, float | None]]]]
"""Pairs of a time, and the fields that are lit then, with the times to author at."""


class _Lighter:
    """Lights a stage at single times, a context manager. It reads nothing until there is one.

    Args:
        stage, settings, request, device: See `Relighting`.
        work: The times.
        still: Time at which fields that do not change are lit.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        work: _Work,
        settings: RenderSettings,
        request: RelightRequest,
        device: Callable[[], Device],
        still: float | None,
    ) -> None:
        self._stage, self._work, self._settings = stage, work, settings
        self._request, self._open_device, self._still = request, device, still
        self._stack = ExitStack()
        self._opened: tuple[Engine, Device] | None = None
        self._buffers: FrameBuffers | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self._buffers = None
        self._stack.__exit__(*error)

    def light(self, number: int, say: Callable[[int, Sequence[Finding]], None]) -> LitTime:
        """Light the stage at the time with a number.

        Args:
            number: Number of the time.
            say: Called with the findings before anything is lit.
        """
        engine, device = self._engine()
        at, samples = self._work[number]
        engine.set_time(at)
        engine.sync()
        scene = engine.render_scene
        asked = (*engine.findings, *few_light_samples(scene, self._settings))
        findings = tuple(map(of_picture, asked))
        say(number, findings)
        if self._buffers is None:
            self._buffers = FrameBuffers(device.resident)
        gains = field_gains(device, scene, self._settings.resolved(()), self._buffers)
        fields = {path: field for path, field, _ in scene.drawn()}
        lit = {}
        for path in (path for path, _ in samples if path in gains):
            spec = fields[path].spec
            fitted = fit_colors(spec.cloud.sh, gains[path], spec.color_space)
            residual = None
            if not any(scene.light(each) for each in spec.captured_lights):
                surface = fields[path].surface_values(None)
                residual = estimate(spec.cloud, spec.color_space, surface).residual
            lit[path] = LitField(
                cloud=replace(spec.cloud, sh=fitted.sh), error=fitted.error, worst=fitted.worst,
                residual=residual,
            )  # fmt: skip
        return LitTime(findings=findings, has_lights=bool(scene.lights), fields=lit)

    def _engine(self) -> tuple[Engine, Device]:
        """Return the engine and the device, which are opened the first time."""
        if self._opened is None:
            self._stack.enter_context(photographed_in(self._stage, self._request.captured_hdri))
            engine = Engine(self._stage, time=self._still, device="cpu")
            self._opened = self._stack.enter_context(engine), self._open_device()
        return self._opened


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
    """Return the paths of the fields to relight; others that were asked for are findings, but not
    fields for other renderers, of which a splat tree is drawn instead."""
    found, paths, roots = [], [], find_roots(stage)
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        path = str(prim.GetPath())
        if not (schema.is_splat_field(prim) or schema.is_tree(prim)) or roots.is_replaced(prim):
            continue
        paths.append(path)
        if prims and not any(_is_beneath(path, each) for each in prims):
            continue
        if schema.is_tree(prim) or prim.IsInstanceProxy():
            findings.add(_why_not(prim))
        else:
            found.append(path)
    for each in prims:
        if not any(_is_beneath(path, each) for path in paths):
            more = f" and {len(paths) - MOST_NAMED} more" if len(paths) > MOST_NAMED else ""
            named = ", ".join(paths[:MOST_NAMED]) or "none"
            raise StageError("--prim", each, f"a field: {named}{more}")
    if not found:
        raise StageError("fields", "none that can be relit", "a visible splat field")
    return found


def _why_not(prim: Usd.Prim) -> Finding:
    """Return the finding on a prim that is not relit."""
    path, expected = str(prim.GetPath()), "a visible field that is drawn once"
    if schema.is_tree(prim):
        expected = "a splat field; render --lighting relit relights trees in the picture"
        return finding("not-relit", path, "a splat tree", expected)
    if schema.lighting_mode(prim) == "captured":
        where = f"{path}.{schema.tokens.LIGHTING}"
        return finding("not-relit", where, "'captured'", "'auto' or 'relit'")
    return finding("not-relit", path, "a field that is hidden, empty or instanced", expected)


def _is_beneath(path: str, prim: str) -> bool:
    return path == prim or path.startswith(prim.rstrip("/") + "/")
