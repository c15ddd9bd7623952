"""Check the harmonics, colour space, hints and grade of a field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from pxr import Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding
from usdsplat.core.sh import MAX_DEGREE
from usdsplat.core.wording import counted
from usdsplat.schema import attributes, grading, hints, tokens
from usdsplat.schema.validation.finding import Sample

INTERCHANGE_DEGREE = 3
"""Highest degree that other applications read."""


def degree(sample: Sample) -> Iterator[Finding]:
    """Check the degree: 0 to 4, or 0 to 3 for other applications."""
    found = sample.degree
    if not 0 <= found <= MAX_DEGREE:
        cure = "author the degree that the coefficients have"
        yield sample.finding(
            "error", tokens.SH_DEGREE, "degree", str(found), f"0 to {MAX_DEGREE}", cure
        )
    elif found > INTERCHANGE_DEGREE:
        yield sample.finding(
            "warning",
            tokens.SH_DEGREE,
            "interchange-degree",
            str(found),
            f"at most {INTERCHANGE_DEGREE}, which other applications read",
            "lower the degree for interchange",
        )


def coefficients(sample: Sample) -> Iterator[Finding]:
    """Check for (degree + 1)^2 coefficients per splat, and matching metadata."""
    if sample.is_packed or not sample.count or sample.degree < 0:
        return
    name = sample.name(tokens.SH_COEFFICIENTS)
    values = sample.array(name)
    if values is None:
        cure = "author coefficients; readers draw grey instead"
        yield sample.finding("warning", name, "missing", "no value", "harmonics", cure)
        return
    expected = sample.count * sample.coefficients
    if len(values) != expected:
        short = len(values) < expected
        cure = "author (degree + 1)^2 for each centre; readers "
        yield sample.finding(
            "error" if short else "warning",
            name,
            "coefficient-count",
            counted(len(values), "coefficient"),
            f"{expected} ({counted(sample.count, 'splat')} of degree {sample.degree})",
            cure + ("draw grey instead" if short else "ignore the rest"),
        )
    yield from _metadata(sample, name)


def color_space(sample: Sample) -> Iterator[Finding]:
    """Check that the field has an authored colour space, and that USD knows it."""
    name = hints.written_color_space(sample.prim)
    cure = f"apply ColorSpaceAPI and set {tokens.COLOR_SPACE} to {tokens.DEFAULT_COLOR_SPACE}"
    if not name:
        yield sample.finding(
            "warning", tokens.COLOR_SPACE, "no-color-space", "no colour space", "a named one", cure
        )
    elif name in tokens.COLOR_SPACE_ALIASES or not hints.is_known_color_space(name):
        known = name in tokens.COLOR_SPACE_ALIASES
        yield sample.finding(
            "warning" if known else "error",
            tokens.COLOR_SPACE,
            "unknown-color-space",
            f"{name!r}, which USD does not know",
            "a name from Gf.ColorSpaceNames",
            f"write {tokens.COLOR_SPACE_ALIASES[name]!r}" if known else cure,
        )


def modes(sample: Sample) -> Iterator[Finding]:
    """Check that rendering hints have values of the schema."""
    for name, allowed in (
        (tokens.PROJECTION_MODE, tokens.PROJECTION_MODES),
        (tokens.SORTING_MODE, tokens.SORTING_MODES),
        (tokens.RASTERIZE_MODE, tokens.RASTERIZE_MODES),
        (tokens.LIGHTING, tokens.LIGHTING_MODES),
    ):
        attribute = sample.prim.GetAttribute(name)
        value = attribute.Get() if attribute else None
        if value is not None and value not in allowed:
            expected = f"one of {', '.join(allowed)}"
            cure = f"author one of these; readers assume {allowed[0]}"
            yield sample.finding("error", name, "unknown-mode", repr(value), expected, cure)
    attribute = sample.prim.GetAttribute(tokens.FOOTPRINT)
    size = attribute.Get() if attribute else None
    if isinstance(size, float) and not 0 <= size < math.inf:
        expected = "the size of a pixel at the splats, or 0"
        cure = "author the size; readers take 0, which is unknown"
        yield sample.finding("error", tokens.FOOTPRINT, "unknown-mode", f"{size:g}", expected, cure)


def grade(sample: Sample) -> Iterator[Finding]:
    """Check the grade at its own sample times if only it is animated."""
    times = attributes.sample_times(sample.prim, tokens.GRADE_ATTRIBUTES)
    codes = [Usd.TimeCode(time) for time in times] if sample.code.IsDefault() else []
    for code in codes or [sample.code]:
        try:
            grading.grade(sample.prim, code)
        except StageError as error:
            path, name = error.where.split()
            cure = "author a legal value; readers do not draw the field"
            at = replace(sample, code=code)
            wrong = at.finding("error", name, "illegal-grade", error.found, error.expected, cure)
            yield replace(wrong, path=path)  # that of an ancestor if the value is inherited
            return


def _metadata(sample: Sample, name: str) -> Iterator[Finding]:
    """Check metadata that Pixar's importer writes and NVIDIA's rule VG.035 requires."""
    primvar = UsdGeom.Primvar(sample.prim.GetAttribute(name))
    size, interpolation = primvar.GetElementSize(), primvar.GetInterpolation()
    if size != sample.coefficients:
        expected = f"{sample.coefficients}, (degree + 1)^2"
        cure = "set the attribute's elementSize"
        yield sample.finding("warning", name, "element-size", f"elementSize {size}", expected, cure)
    if interpolation != UsdGeom.Tokens.vertex:
        cure = "set the attribute's interpolation"
        yield sample.finding(
            "warning", name, "interpolation", f"interpolation {interpolation}", "vertex", cure
        )
