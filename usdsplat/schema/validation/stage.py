"""Check values of a stage that rendering depends on besides the splats: up axis, transforms,
cameras and data windows."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Usd, UsdGeom, UsdRender

from usdsplat.core.errors import StageError
from usdsplat.schema.stage_values import (
    are_finite,
    local_to_world,
    unknown_ops,
    up_axis_problem,
)
from usdsplat.schema.validation.finding import Finding

_CAMERA = (
    "clippingRange",
    "focalLength",
    "horizontalAperture",
    "verticalAperture",
    "horizontalApertureOffset",
    "verticalApertureOffset",
)


def check_stage(stage: Usd.Stage, time: float | None) -> list[Finding]:
    """Return findings on transforms, cameras and data windows, and on the up axis.

    Args:
        stage: The stage; it is not modified.
        time: Time code to check; None checks the stage's first sample of each attribute.
    """
    code = Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)
    cache = UsdGeom.XformCache(code)
    findings: list[Finding] = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Xformable):
            findings += _transform(prim, cache)
        if prim.IsA(UsdGeom.Camera):
            findings += _numbers(prim, _CAMERA, code)
        elif prim.IsA(UsdRender.SettingsBase):
            findings += _numbers(prim, ("dataWindowNDC",), code)
    problem = up_axis_problem(stage)
    if problem is not None:
        findings.append(
            _error("/", "", "upAxis", f"upAxis {problem.found}", "Y or Z", "author Y or Z")
        )
    return findings


def _transform(prim: Usd.Prim, cache: UsdGeom.XformCache) -> Iterator[Finding]:
    path = str(prim.GetPath())
    unknown = list(unknown_ops(prim))
    for op in unknown:
        cure = "remove it from xformOpOrder, or author its attribute with a name that USD knows"
        found = f"the op {op!r} without a meaning in USD or without an attribute"
        yield _error(path, "xformOpOrder", "unknownOp", found, "transform ops of USD", cure)
    if unknown:
        return
    try:
        matrix = local_to_world(prim, cache)
    except StageError:
        return  # an ancestor's, which has a finding of its own
    if not are_finite(matrix) and _is_first(prim, cache):
        found, expected = "a transform that is not finite", "finite numbers"
        yield _error(path, "", "transformNotFinite", found, expected, "author finite ops")


def _is_first(prim: Usd.Prim, cache: UsdGeom.XformCache) -> bool:
    """Return whether the parent's transform is finite, so that the prim's own is not."""
    parent = prim.GetParent()
    return not parent or are_finite(local_to_world(parent, cache))


def _numbers(prim: Usd.Prim, names: tuple[str, ...], code: Usd.TimeCode) -> Iterator[Finding]:
    for name in names:
        value = prim.GetAttribute(name).Get(code)
        if value is not None and not are_finite(value):
            found = f"{value}, which is not finite"
            cure = "author finite numbers"
            yield _error(str(prim.GetPath()), name, "notFinite", found, "finite numbers", cure)


def _error(path: str, attribute: str, name: str, found: str, expected: str, cure: str) -> Finding:
    return Finding(
        severity="error",
        path=path,
        attribute=attribute,
        name=name,
        found=found,
        expected=expected,
        cure=cure,
    )
