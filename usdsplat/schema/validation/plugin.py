"""The checks as validators of UsdValidation: USD imports this module when somebody asks for one.

plugInfo.json declares them, so any process that has our folder in PXR_PLUGINPATH_NAME lists them
without importing anything of ours.
"""

from __future__ import annotations

from collections.abc import Callable

from pxr import Usd, UsdValidation

from usdsplat.schema.field import is_splat_field
from usdsplat.schema.validation import CHECKS, check_field, sample_codes
from usdsplat.schema.validation.finding import Finding

_TYPES = {
    "error": UsdValidation.ValidationErrorType.Error,
    "warning": UsdValidation.ValidationErrorType.Warn,
}


def _validator(group: str) -> Callable[..., list[UsdValidation.ValidationError]]:
    """The checks of a group as the function that UsdValidation calls for a prim."""

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
        return [_error(prim, finding) for finding in check_field(prim, CHECKS[group], codes)]

    return run


def _error(prim: Usd.Prim, finding: Finding) -> UsdValidation.ValidationError:
    """A finding in UsdValidation's words."""
    path = prim.GetPath()
    if finding.attribute and prim.HasAttribute(finding.attribute):
        path = path.AppendProperty(finding.attribute)
    site = UsdValidation.ValidationErrorSite(prim.GetStage(), path)
    rule = f" (rule {finding.rule})" if finding.rule else ""
    message = f"{finding.message}; {finding.cure}{rule}"
    return UsdValidation.ValidationError(finding.name, _TYPES[finding.severity], [site], message)


for _group in CHECKS:
    UsdValidation.ValidationRegistry().RegisterPluginPrimValidator(
        f"{__name__}:{_group}", _validator(_group)
    )
