"""Check the transform ops of a stage."""

from __future__ import annotations

from pxr import Usd, UsdGeom

from usdsplat.core.findings import Finding, finding
from usdsplat.schema.stage_values import EXPECTED_OPS, in_world, unknown_ops

_CURE = "remove the op from xformOpOrder, or author its attribute with a name that USD knows"


def check_transforms(stage: Usd.Stage) -> list[Finding]:
    """Return a finding for each transform op that USD does not know or that has no attribute."""
    return [
        finding(
            "bad-transform", f"{prim.GetPath()}.xformOpOrder", repr(op), EXPECTED_OPS, cure=_CURE
        )
        for prim in in_world(stage)
        if prim.IsA(UsdGeom.Xformable)
        for op in unknown_ops(prim)
    ]
