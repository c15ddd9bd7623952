"""Provide the checks as UsdValidation validators; USD imports this module on demand.

plugInfo.json beside this module declares them, so any process with this folder in
PXR_PLUGINPATH_NAME lists them without importing our package. Only a Python that can import the
package may have the folder on its path (`usdsplat plugin-path --validators`).
"""

from __future__ import annotations

from collections.abc import Callable

from pxr import Usd, UsdValidation

from usdsplat.core.findings import Finding
from usdsplat.schema.field import is_splat_field
from usdsplat.schema.tree import is_tree
from usdsplat.schema.validation import (
    CHECKS,
    TREES,
    VALIDATORS,
    check_field,
    check_tree,
    sample_codes,
)

_TYPES = {
    "error": UsdValidation.ValidationErrorType.Error,
    "warning": UsdValidation.ValidationErrorType.Warn,
    "note": UsdValidation.ValidationErrorType.Info,
}


_CHOICES = ("half-only", "interchange-degree")
"""Findings about a form that the user chose, which `usdsplat validate` prints: they are no faults
of an asset, which UsdValidation lists."""


def _validator(group: str) -> Callable[..., list[UsdValidation.ValidationError]]:
    """Return a group of checks as a function for UsdValidation."""

    def run(
        prim: Usd.Prim, time_range: UsdValidation.ValidationTimeRange
    ) -> list[UsdValidation.ValidationError]:
        if not is_splat_field(prim):
            return []
        interval = time_range.GetInterval()
        codes = [
            code
            for code in sample_codes(prim)
            if code.IsDefault() or interval.Contains(code.GetValue())
        ]
        found = check_field(prim, CHECKS[group], codes)
        return [_error(prim, each) for each in found if each.code not in _CHOICES]

    return run


def _of_trees(
    prim: Usd.Prim, time_range: UsdValidation.ValidationTimeRange
) -> list[UsdValidation.ValidationError]:
    """Return the errors of a splat tree, which does not change over time."""
    return [_error(prim, each) for each in check_tree(prim)] if is_tree(prim) else []


def _camel(code: str) -> str:
    """Return a code as the name of a UsdValidation error, which must be an identifier."""
    first, *rest = code.split("-")
    return first + "".join(word.capitalize() for word in rest)


def _error(prim: Usd.Prim, finding: Finding) -> UsdValidation.ValidationError:
    """Convert a finding to an error of UsdValidation."""
    path = prim.GetPath()
    if finding.attribute and prim.HasAttribute(finding.attribute):
        path = path.AppendProperty(finding.attribute)
    site = UsdValidation.ValidationErrorSite(prim.GetStage(), path)
    rule = f" (rule {finding.rule})" if finding.rule else ""
    message = f"{finding.message}; {finding.cure}{rule}"
    name, kind = _camel(finding.code), _TYPES[finding.severity]
    return UsdValidation.ValidationError(name, kind, [site], message)


for _group in VALIDATORS:
    UsdValidation.ValidationRegistry().RegisterPluginPrimValidator(
        f"{__name__}:{_group}", _of_trees if _group == TREES else _validator(_group)
    )
