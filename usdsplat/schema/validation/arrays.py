"""Check the lengths, types and values of a field's arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat.core.cloud import F32
from usdsplat.core.findings import Finding, Severity
from usdsplat.core.wording import counted
from usdsplat.schema import attributes, stock, tokens
from usdsplat.schema.surface_primvars import has_normals
from usdsplat.schema.validation.finding import Sample
from usdsplat.schema.validation.value_types import actual_type, expected_type

UNIT_TOLERANCE = 1e-3
"""Tolerance for the length of a quaternion; the bound of NVIDIA's rule VG.035."""

WRONG_TYPE = "wrong-type"
"""Code of a finding about the type of an attribute."""

_STOCK = (*tokens.HALF_OF, tokens.SH_DEGREE)
_PACKED = (tokens.POSITIONS, *tokens.PACKED_ARRAYS, tokens.SH_DEGREE)
_BOTH = (tokens.IDS, tokens.VELOCITIES, tokens.EXTENT)

_WITHOUT = {
    tokens.ORIENTATIONS: "no rotation",
    tokens.SCALES: "unit scale",
    tokens.OPACITIES: "full opacity",
}


def value_types(sample: Sample) -> Iterator[Finding]:
    """Check that values have the types of the schema."""
    for attribute in (*(_PACKED if sample.is_packed else _STOCK), *_BOTH):
        name = sample.name(attribute)
        if not sample.is_typed(name):
            found, expected = actual_type(sample.value(name)), expected_type(name)
            cure = (
                f"author it as {expected}; otherwise readers ignore the attribute or the whole "
                "field"
            )
            yield sample.finding("error", name, WRONG_TYPE, f"{found}", f"{expected}", cure)


def first_samples(sample: Sample) -> Iterator[Finding]:
    """Check that the first sample has values: other readers otherwise expect a half array."""
    for attribute in () if sample.is_packed else tokens.HALF_OF:
        if sample.name(attribute) != attribute or not len(sample.numbers(attribute)):
            continue
        if stock.begins_empty(sample.prim, attribute):
            half = tokens.HALF_OF[attribute]
            found = "values after an empty first sample"
            expected = (
                "values in the first sample too; otherwise readers that follow USD's rule look "
                f"for {half}"
            )
            cure = "begin with at least one splat; its opacity can be 0"
            yield sample.finding("warning", attribute, "empty-first", found, expected, cure)


def lengths(sample: Sample) -> Iterator[Finding]:
    """Check that every per-splat array has as many values as there are centres."""
    n = sample.count
    if not n:
        cure = "author positions"
        found, expected = "no centres", "at least one"
        yield sample.finding("warning", tokens.POSITIONS, "no-splats", found, expected, cure)
        return
    for name, consequence in ({} if sample.is_packed else _WITHOUT).items():
        yield from _length(sample, name, n, f"readers use {consequence} instead")
    for name in (tokens.IDS, tokens.VELOCITIES):
        values = sample.array(name)
        if values is not None and len(values):
            yield from _length(sample, name, n, "readers ignore it")
    if has_normals(sample.prim):
        for name in (tokens.NORMALS, tokens.CONFIDENCE, tokens.OCCLUSION):
            if sample.array(f"primvars:{name}") is not None:
                yield from _length(sample, f"primvars:{name}", n, "readers compute it")


def values(sample: Sample) -> Iterator[Finding]:
    """Check for finite centres, positive scales, unit quaternions, opacities in [0..1]."""
    yield from _finite(sample, tokens.POSITIONS)
    yield from _finite(sample, tokens.VELOCITIES)
    if sample.is_packed:
        return
    for name in (tokens.SCALES, tokens.ORIENTATIONS, tokens.OPACITIES, tokens.SH_COEFFICIENTS):
        yield from _finite(sample, name)
    yield from scales(sample)
    yield from _quaternions(sample)
    yield from opacities(sample)


def identities(sample: Sample) -> Iterator[Finding]:
    """Check that ids are unique."""
    ids = sample.array(tokens.IDS)
    if ids is None or len(ids) < 2:
        return
    ordered = np.sort(ids)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if len(repeated):
        found = f"{len(repeated)} repeated (first: {repeated[0]})"
        cure = "give every splat a unique id, or remove the attribute"
        yield sample.finding("error", tokens.IDS, "repeated-ids", found, "each id once", cure)


def half_only(sample: Sample) -> Iterator[Finding]:
    """Check for float arrays, which other applications require."""
    names = {} if sample.is_packed else {name: sample.name(name) for name in tokens.HALF_OF}
    halves = [half for name, half in names.items() if half != name and _has_values(sample, name)]
    if halves:
        listed = ", ".join(halves)
        expected = "the float attributes, which other applications require"
        cure = "convert to the float form for interchange"
        yield sample.finding("warning", halves[0], "half-only", f"only {listed}", expected, cure)


def _has_values(sample: Sample, attribute: str) -> bool:
    """Return whether an attribute has values, without converting half to float."""
    values = sample.array(attribute)
    return values is not None and len(values) > 0


def _length(sample: Sample, attribute: str, n: int, consequence: str) -> Iterator[Finding]:
    """Check the length of an array against the number of centres."""
    values = sample.array(attribute)
    found = 0 if values is None else len(values)
    name = sample.name(attribute)
    expected = counted(n, "value")
    if values is None:
        cure = f"author it; {consequence}"
        yield sample.finding("warning", name, "missing", "no value", expected, cure)
    elif found < n:
        cure = f"author one value for each centre; {consequence}"
        yield sample.finding("error", name, "too-short", counted(found, "value"), expected, cure)
    elif found > n:
        cure = "author one value for each centre; readers ignore the rest"
        yield sample.finding("warning", name, "too-long", counted(found, "value"), expected, cure)


def _finite(sample: Sample, attribute: str) -> Iterator[Finding]:
    """Check for NaN and infinity."""
    numbers = sample.numbers(attribute)
    if not numbers.size or (np.isfinite(numbers.min()) and np.isfinite(numbers.max())):
        return
    bad = np.logical_not(np.isfinite(numbers).reshape(len(numbers), -1).all(axis=1))
    yield sample.finding(
        "error",
        sample.name(attribute),
        "not-finite",
        _rows(bad, numbers),
        "finite numbers",
        "prune the splats with NaN or infinity",
    )


def scales(sample: Sample) -> Iterator[Finding]:
    """Check scales: negative is an error; zero is legal here but rejected by other readers."""
    deviations = sample.numbers(tokens.SCALES)
    lowest = deviations.min(axis=1, initial=np.inf) if deviations.size else deviations
    if (lowest < 0).any():
        cure = "author standard deviations; if these are logarithms, take their exponential"
        found = _rows(lowest < 0, deviations)
        name = sample.name(tokens.SCALES)
        yield sample.finding("error", name, "negative-scale", found, "positive numbers", cure)
    flat = lowest == 0
    if flat.any():
        cure = "give flat splats a small thickness: other applications require scales above 0"
        severity: Severity = "warning"
        newborn = _newborn(sample)
        if len(newborn) == len(flat) and newborn[flat].all():
            severity = "note"
            cure = (
                "none is needed here: these splats begin in this sample and grow; for applications "
                "that require scales above 0, delete the sample's splats of scale 0"
            )
        found = _rows(flat, deviations)
        name = sample.name(tokens.SCALES)
        yield sample.finding(severity, name, "zero-scale", found, "positive numbers", cure)


def _newborn(sample: Sample) -> npt.NDArray[np.bool_]:
    """Return which splats are not in the sample before, by their ids, or are invisible there,
    shape (n,). A bake gives a splat a row before its birth, with opacity 0."""
    ids = sample.array(tokens.IDS)
    none = np.zeros(sample.count, np.bool_)
    if ids is None or len(ids) != sample.count or not sample.code.IsNumeric():
        return none
    names = {tokens.IDS, sample.name(tokens.OPACITIES)}
    times = attributes.sample_times(sample.prim, names)
    earlier = [time for time in times if time < sample.code.GetValue()]
    if not earlier:
        return none
    before = replace(sample, code=Usd.TimeCode(max(earlier)))
    known, opacity = before.array(tokens.IDS), before.numbers(tokens.OPACITIES)
    if known is None:
        return none
    return ~np.isin(ids, known[opacity > 0] if len(opacity) == len(known) else known)


def _quaternions(sample: Sample) -> Iterator[Finding]:
    """Check that quaternions have length 1."""
    quaternions = sample.numbers(tokens.ORIENTATIONS)
    if not quaternions.size:
        return
    lengths = np.sqrt(np.einsum("ni,ni->n", quaternions, quaternions))
    bad = np.abs(lengths - 1) > UNIT_TOLERANCE
    if bad.any():
        yield sample.finding(
            "error",
            sample.name(tokens.ORIENTATIONS),
            "not-unit",
            _rows(bad, lengths, "norm "),
            f"length 1 within {UNIT_TOLERANCE:g}",
            "normalise the quaternions",
        )


def opacities(sample: Sample) -> Iterator[Finding]:
    """Check that opacities lie between 0 and 1."""
    if sample.is_packed:
        return
    found = sample.numbers(tokens.OPACITIES)
    if not found.size or (found.min() >= 0 and found.max() <= 1):
        return
    bad = (found < 0) | (found > 1)
    if bad.any():
        yield sample.finding(
            "error",
            sample.name(tokens.OPACITIES),
            "opacity-range",
            _rows(bad, found),
            "0 to 1",
            "author opacities; if these are logits, take their sigmoid",
        )


def _rows(bad: Any, numbers: F32, what: str = "") -> str:
    """Describe the number of bad rows, and the numbers (`what`) of the first."""
    first = int(np.argmax(bad))
    value = " ".join(f"{x:g}" for x in np.atleast_1d(numbers[first])[:4])
    return f"{int(bad.sum())} of {len(bad)} (first: {what}{value} at splat {first})"
