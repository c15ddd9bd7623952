"""Match the colours of splats to a plate or a chart: draw, compare, fit a grade, write it, and
compare again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError, StageError, UsageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.grade import Grade
from usdsplat.delegate.engine import Engine
from usdsplat.images.color import convert
from usdsplat.images.match import fit_grade, in_primaries
from usdsplat.images.plate import Plate, read_plate
from usdsplat.images.science import chart, delta_e
from usdsplat.interchange.over_layer import save_over
from usdsplat.products.planning import find_camera
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

OPAQUE = 0.99
"""Coverage from which a pixel counts as opaque."""
CODES = (0.02, 0.98)
"""Range of sRGB code values of the splats without clipping."""
MOST = 200_000
"""Maximum number of pixels for the fit; a larger set is subsampled evenly."""

Pixels = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchRequest:
    """Request to match, with either a reference or a chart with patches."""

    target: Path
    camera: str | None
    prims: tuple[str, ...]
    parts: tuple[str, ...]
    reference: Path | None
    reference_space: str | None
    chart: str | None
    patches: str | None
    resolution: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchReport:
    """Result of a match. The matrix is for column vectors and linear Rec.709."""

    target: str
    prim_paths: tuple[str, ...]
    kind: str
    samples: int
    used: int
    exposure: float
    temperature: float
    tint: float
    matrix: tuple[tuple[float, ...], ...]
    delta_e: dict[str, dict[str, float]]
    notes: tuple[str, ...]
    reference_space: str = ""
    """Colour space that the reference was read as; "" for a chart."""
    reference_space_source: str = ""
    """"given", "file", "format" or "assumed", see `images.plate`; "" for a chart."""
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Goal:
    """Target of the fit: how to measure colours in a picture, and the wanted colours."""

    measure: Callable[[Pixels], F64]
    """Return the unpremultiplied linear Rec.709 colours of a picture, shape (n, 3)."""
    wanted: F64
    kind: str
    """Kind of the colours, "pixels" or "patches"."""


def match(engine: Engine, stage: Usd.Stage, request: MatchRequest) -> MatchReport:
    """Fit a grade and write it to a new layer. The stage's own layers are not changed.

    Raises:
        StageError: If the camera or a field does not exist, or no field can be graded.
        UsageError: If there are no pixels to compare, or an option is wrong.
        FormatError: If a file cannot be read.
    """
    camera = _camera(engine, request.camera)
    fields, notes = _fields(engine, stage, request.prims)
    grades = Sdf.Layer.CreateAnonymous("grade.usda")
    stage.GetSessionLayer().subLayerPaths.insert(0, grades.identifier)
    _author(stage, grades, fields, Grade())
    plate = None
    if request.reference is not None:
        plate = read_plate(request.reference, space=request.reference_space)
        rows, columns = plate.rgb.shape[:2]
        view = engine.view(camera, resolution=(columns, rows))
        picture, own = _draw(engine, view, fields)
        goal = _pixels(picture, own & plate.usable, plate.rgb, str(request.reference))
    else:
        view = engine.view(camera, resolution=request.resolution)
        picture, own = _draw(engine, view, fields)
        goal = _patches(own, request)
    found = goal.measure(picture)
    fit = fit_grade(found, goal.wanted, parts=request.parts)
    _author(stage, grades, fields, fit.grade)
    after = goal.measure(_draw(engine, view, fields)[0])
    differences = [delta_e(colors, goal.wanted) for colors in (found, after)]
    if differences[1].mean() > differences[0].mean():
        notes.append("the grade is no improvement: check that both show the same view")
    save_over(grades, stage, request.target)
    return MatchReport(
        target=str(request.target),
        prim_paths=tuple(str(prim.GetPath()) for prim in fields),
        kind=goal.kind,
        samples=len(found),
        used=fit.used,
        exposure=fit.grade.exposure,
        temperature=fit.grade.temperature,
        tint=fit.grade.tint,
        matrix=tuple(fit.grade.matrix[row : row + 3] for row in (0, 3, 6)),
        delta_e={
            when: {"mean": float(values.mean()), "median": float(np.median(values))}
            for when, values in zip(("before", "after"), differences, strict=True)
        },
        notes=(*fit.notes, *notes),
        reference_space=plate.space if plate else "",
        reference_space_source=plate.space_source if plate else "",
        findings=_assumptions(request, plate),
    )


def _assumptions(request: MatchRequest, plate: Plate | None) -> tuple[Finding, ...]:
    """Return a finding if the colour space of the reference is a guess."""
    if plate is None or plate.space_source != "assumed":
        return ()
    expected = f"--reference-space; {plate.space} is assumed"
    where = str(request.reference)
    return (finding("assumed-space", where, "no colour space", expected, attribute=""),)


def _camera(engine: Engine, name: str | None) -> str:
    """Return the camera. A comparison needs exactly one."""
    if name is not None:
        return find_camera(engine, name)
    paths = engine.cameras()
    if len(paths) != 1:
        expected = f"one of {', '.join(paths)}" if paths else "a stage with a camera"
        raise StageError("--camera", "none", expected)
    return paths[0]


def _fields(
    engine: Engine, stage: Usd.Stage, prims: tuple[str, ...]
) -> tuple[list[Usd.Prim], list[str]]:
    """Return the fields to grade, and notes on those that cannot be graded."""
    shown = sorted({path for path, _, _ in engine.render_scene.drawn()})
    for prim in prims:
        if not any(_is_beneath(path, prim) for path in shown):
            raise StageError("--prim", prim, f"a visible field: {', '.join(shown) or 'none'}")
    chosen = [path for path in shown if not prims or any(_is_beneath(path, p) for p in prims)]
    fields = [stage.GetPrimAtPath(path) for path in chosen]
    able = [prim for prim in fields if prim and not prim.IsInstanceProxy()]
    notes = [
        f"{path} is not graded: it is inside an instance"
        for path, prim in zip(chosen, fields, strict=True)
        if prim not in able
    ]
    if not able:
        found = f"none that a layer can change ({', '.join(chosen) or 'nothing is visible'})"
        raise StageError("fields", found, "one that is visible and not inside an instance")
    return able, notes


def _is_beneath(path: str, prim: str) -> bool:
    return path == prim or path.startswith(prim.rstrip("/") + "/")


def _author(stage: Usd.Stage, layer: Sdf.Layer, fields: list[Usd.Prim], grade: Grade) -> None:
    """Author all attributes of a grade, so that nothing of an older grade is left."""
    with Usd.EditContext(stage, layer):
        for prim in fields:
            own = in_primaries(grade, schema.color_space(prim))
            schema.author_grade(
                prim,
                exposure=own.exposure,
                temperature=own.temperature,
                tint=own.tint,
                gain=own.gain,
                saturation=own.saturation,
                matrix=own.matrix,
            )


def _draw(
    engine: Engine, view: View, fields: list[Usd.Prim]
) -> tuple[Pixels, npt.NDArray[np.bool_]]:
    """Return unpremultiplied linear Rec.709 colours, and where only the fields are visible."""
    pictures = engine.picture(view, RenderSettings(color_mode="scene"), ("color", "primId"))
    color = np.asarray(pictures["color"])
    paths = {str(prim.GetPath()) for prim in fields}
    seen_as = {item.path for path, _, item in engine.render_scene.drawn() if path in paths}
    numbers = [i for i, path in enumerate(engine.drawn_paths()) if path in seen_as]
    own = np.isin(pictures["primId"], numbers) & (color[..., 3] > OPAQUE)
    divisor = np.where(own, color[..., 3], np.float32(1))[..., None]
    return np.asarray(color[..., :3] / divisor, np.float32), own


def _pixels(picture: Pixels, usable: npt.NDArray[np.bool_], wanted: Pixels, where: str) -> _Goal:
    """Return the target for a comparison by pixels."""
    code = convert(picture, "lin_rec709_scene", "srgb_rec709_scene")
    usable = usable & (code > CODES[0]).all(axis=2) & (code < CODES[1]).all(axis=2)
    at = np.flatnonzero(usable)
    if not len(at):
        expected = "opaque pixels, neither black nor clipped, in which splats are visible"
        raise UsageError("--reference", f"none in {where}", expected)
    at = at[:: -(-len(at) // MOST)]

    def measure(image: Pixels) -> F64:
        return image.reshape(-1, 3)[at].astype(np.float64)

    return _Goal(measure=measure, wanted=measure(wanted), kind="pixels")


def _patches(own: npt.NDArray[np.bool_], request: MatchRequest) -> _Goal:
    """Return the target for a comparison by patches, each the mean of its region."""
    assert request.chart is not None and request.patches is not None
    colors = chart(request.chart)
    regions = _regions(request.patches, tuple(colors))
    places = {}
    for name, (x0, y0, x1, y1) in regions.items():
        inside = np.zeros(own.shape, np.bool_)
        inside[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = True
        places[name] = np.flatnonzero(inside & own)
        if not len(places[name]):
            found = f"{x0},{y0},{x1},{y1}, where nothing is opaque"
            raise UsageError(f"patch {name!r}", found, "a region of the picture with splats")

    def measure(image: Pixels) -> F64:
        rows = image.reshape(-1, 3).astype(np.float64)
        return np.array([rows[at].mean(axis=0) for at in places.values()])

    wanted = np.array([colors[name] for name in places])
    return _Goal(measure=measure, wanted=wanted, kind="patches")


def _regions(text: str, names: tuple[str, ...]) -> dict[str, tuple[int, int, int, int]]:
    """Return patch name -> region."""
    listed: Any
    if text.lower().endswith(".json"):
        try:
            listed = json.loads(Path(text).read_text(encoding="utf-8"))
        except ValueError as error:
            raise FormatError(text, f"invalid JSON ({error})", "a list or an object") from None
    else:
        listed = [part.split(",") for part in text.split(";") if part.strip()]
    if isinstance(listed, dict):
        for name in listed:
            if name not in names:
                raise UsageError("--patches", repr(name), f"one of {', '.join(names)}")
    elif isinstance(listed, list) and len(listed) == len(names):
        listed = dict(zip(names, listed, strict=True))
    else:
        found = (
            f"{len(listed)} regions" if isinstance(listed, list) else "neither a list nor an object"
        )
        raise UsageError("--patches", found, f"{len(names)}, one for each patch of the chart")
    return {name: _region(name, value) for name, value in listed.items() if value is not None}


def _region(name: str, value: Any) -> tuple[int, int, int, int]:
    try:
        x0, y0, x1, y1 = (int(number) for number in value)
    except (TypeError, ValueError):
        raise UsageError(f"patch {name!r}", repr(value), "x0,y0,x1,y1 in pixels") from None
    return x0, y0, x1, y1
