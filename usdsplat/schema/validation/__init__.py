"""Validate the splat fields of a stage; each finding names its cure.

`validate` implements `usdsplat validate`. The same checks are plug-in validators of UsdValidation
(see `plugin`), which other applications discover through plugInfo.json.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from pxr import Usd

from usdsplat.core.findings import Finding
from usdsplat.core.findings import finding as make_finding
from usdsplat.core.progress import Progress, silent
from usdsplat.schema import attributes, tokens
from usdsplat.schema.field import is_splat_field
from usdsplat.schema.validation import arrays, box, packing, radiance
from usdsplat.schema.validation.finding import Sample
from usdsplat.schema.validation.transforms import check_transforms
from usdsplat.schema.validation.trees import (
    check_tree,
    missing_chunks,
    splat_trees,
    tree_findings,
)

__all__ = [
    "CHECKS",
    "TREES",
    "VALIDATORS",
    "Finding",
    "broken_rules",
    "check_field",
    "check_tree",
    "missing_chunks",
    "splat_fields",
    "splat_trees",
    "tree_findings",
    "validate",
]

Check = Callable[[Sample], Iterator[Finding]]

TREES = "SplatTree"
"""Validator of splat trees, which runs `check_tree`."""
VALIDATORS = {
    "SplatArrays": "Arrays of splats have one length and legal, finite numbers.",
    "SplatRadiance": "Harmonics have a legal degree, matching counts, a named colour space and a "
    "legal grade.",
    "SplatExtent": "The extent holds every splat out to where it stops contributing.",
    "SplatPacking": "Packed arrays have a known layout and fit together.",
    TREES: "Splat trees have a valid table of nodes, and all layers that it names.",
}
"""Validator -> its documentation."""

CHECKS: dict[str, Sequence[Check]] = {
    "SplatArrays": (
        arrays.value_types,
        arrays.first_samples,
        arrays.lengths,
        arrays.values,
        arrays.identities,
        arrays.half_only,
    ),
    "SplatRadiance": (
        radiance.degree,
        radiance.coefficients,
        radiance.color_space,
        radiance.modes,
        radiance.grade,
    ),
    "SplatExtent": (box.extent,),
    "SplatPacking": (packing.layout, packing.arrays, packing.ranges),
}
"""Validator of fields -> its checks."""

_OF_FORM: Sequence[Check] = (
    arrays.scales,
    arrays.half_only,
    radiance.degree,
    radiance.coefficients,
)
"""Checks that depend on the storage form of a valid cloud and are fast."""


_OF_DRAWN: Sequence[Check] = (
    arrays.lengths,
    arrays.opacities,
    radiance.degree,
    radiance.coefficients,
    radiance.modes,
)
"""Checks of what is read for drawing."""


def validate(
    stage: Usd.Stage, *, time: float | None = None, progress: Progress = silent
) -> list[Finding]:
    """Check every splat field and tree of a stage, and the transform ops of all prims.

    Args:
        stage: The stage; it is not modified.
        time: Time code to check; None checks every sample, which reads all data.
        progress: Receives the number of checked fields.

    Returns:
        Findings in the order of the fields, then those of trees, transforms and the stage; empty if
        there are none. A fault that several samples of an attribute share is one finding, and so is
        one of a value that several fields inherit.
    """
    fields = list(splat_fields(stage))
    checks = [check for group in CHECKS.values() for check in group]
    findings: list[Finding] = []
    for done, prim in enumerate(fields):
        progress.step("validating", done, len(fields))
        codes = None if time is None else [Usd.TimeCode(time)]
        findings += check_field(prim, checks, codes)
    progress.step("validating", len(fields), len(fields))
    trees = list(splat_trees(stage))
    for prim in trees:
        findings += check_tree(prim)
    findings += check_transforms(stage)
    findings += _stage_metadata(stage) if fields or trees else ()
    once: dict[tuple[str, ...], Finding] = {}
    for each in findings:
        once.setdefault(each.key, each)
    return list(once.values())


def check_field(
    prim: Usd.Prim, checks: Iterable[Check], codes: Iterable[Usd.TimeCode] | None = None
) -> list[Finding]:
    """Run checks on a field at given times or at every sample, merging equal findings."""
    merged: dict[tuple[str, str], Finding] = {}
    for code in sample_codes(prim) if codes is None else codes:
        sample = Sample(prim, code)
        for check in checks:
            for finding in _quietly(check, sample):
                if finding.code != arrays.WRONG_TYPE and not sample.is_typed(finding.attribute):
                    continue  # other findings would only follow from the type
                key = (finding.attribute, finding.code)
                seen = merged.get(key)
                merged[key] = replace(seen, samples=seen.samples + 1) if seen else finding
    return [
        finding if finding.time is not None else replace(finding, samples=1)
        for finding in merged.values()
    ]


def errors_of_drawn(prim: Usd.Prim, time: float | None) -> list[Finding]:
    """Return the errors of a field's values that drawing it hides: unknown modes, short arrays,
    opacities out of range. No attribute is read that drawing does not read.

    Args:
        prim: A field that can be read.
        time: Time code; None for the default value or, without one, the first sample.
    """
    found = check_field(prim, _OF_DRAWN, [attributes.time_code(prim, time)])
    return [finding for finding in found if finding.severity == "error"]


def broken_rules(prim: Usd.Prim, time: float | None = None) -> list[str]:
    """Return a sentence for each published rule that an authored field breaks.

    Unit quaternions and opacities from 0 to 1, which readers ensure, are not checked again, and
    neither is the extent that authoring computed.

    Args:
        prim: A stock or packed prim; no rule applies to packed ones.
        time: Time code of the sample to check; None for the default value, or the first sample.
    """
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    return [
        f"NVIDIA's rule {finding.rule} for splats fails: {finding.attribute}: found "
        f"{finding.found}, expected {finding.expected}"
        for finding in check_field(prim, _OF_FORM, [code])
        if finding.rule
    ]


def _quietly(check: Check, sample: Sample) -> list[Finding]:
    """Run a check without NumPy warnings, because checks also look for extreme numbers."""
    with np.errstate(all="ignore"):
        return list(check(sample))


def _stage_metadata(stage: Usd.Stage) -> Iterator[Finding]:
    """Check metadata that determines the orientation and size of captures."""
    for code, name, assumed in (
        ("no-up-axis", "upAxis", "Y"),
        ("no-meters-per-unit", "metersPerUnit", "0.01"),
    ):
        if not stage.HasAuthoredMetadata(name):
            found = f"no {name}, so that {assumed} is assumed"
            yield make_finding(code, "/", found, f"{name} in the root layer")


def splat_fields(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield the splat fields of a stage, one of each set of equal instances."""
    seen = set()
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not is_splat_field(prim):
            continue
        own = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        if own.GetPath() not in seen:
            seen.add(own.GetPath())
            yield prim


def sample_codes(prim: Usd.Prim) -> list[Usd.TimeCode]:
    """Return the sample times of a field; the default time if it has none."""
    times = attributes.sample_times(prim, tokens.DATA_ATTRIBUTES | {tokens.EXTENT})
    return [Usd.TimeCode(t) for t in times] or [Usd.TimeCode.Default()]
