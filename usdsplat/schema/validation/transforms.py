"""Check the transform ops of a stage."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Usd, UsdGeom

from usdsplat.core.findings import Finding, finding
from usdsplat.schema.stage_values import EXPECTED_OPS, in_world, missing_ops, unknown_ops

_CURE = "remove the op from xformOpOrder, or author its attribute with a name that USD knows"


def check_transforms(stage: Usd.Stage) -> list[Finding]:
    """Return a finding for each transform op that USD does not know or that has no attribute."""
    found = []
    for prim in in_world(stage):
        if prim.IsA(UsdGeom.Xformable):
            where = f"{prim.GetPath()}.xformOpOrder"
            found += [
                finding("bad-transform", where, repr(op), EXPECTED_OPS, cure=_CURE)
                for op in unknown_ops(prim)
            ]
            found += without_attribute(prim)
    return found


def without_attribute(prim: Usd.Prim) -> Iterator[Finding]:
    """Yield a finding for each transform op of a prim that has no attribute."""
    for op in missing_ops(prim):
        yield finding("missing-op", f"{prim.GetPath()}.xformOpOrder", repr(op), "its attribute")
