"""Map findings to published rules for splat assets.

NVIDIA's VG.035 checks prims of the stock type. They must have the float attributes and an extent,
matching lengths, scales above 0, opacities from 0 to 1, unit quaternions, a degree from 0 to 3, and
matching metadata of the harmonics. It does not check packed fields.

Source: NVIDIA's package usd-validation-nvidia 1.22, rule "usdgeom-particle-field-gaussian-splat".
"""

from __future__ import annotations

from usdsplat.schema import tokens

RULE = "VG.035"

_SHAPE = {tokens.SCALES, tokens.ORIENTATIONS, tokens.OPACITIES}
_HALF = set(tokens.HALF_OF.values())
_BROKEN_BY = {
    "no-splats": {tokens.POSITIONS},
    "missing": {*_SHAPE, tokens.SH_COEFFICIENTS},
    "half-only": _HALF,
    "too-short": _SHAPE,
    "too-long": _SHAPE,
    "zero-scale": {tokens.SCALES},
    "negative-scale": {tokens.SCALES},
    "opacity-range": {tokens.OPACITIES},
    "not-unit": {tokens.ORIENTATIONS},
    "degree": {tokens.SH_DEGREE},
    "interchange-degree": {tokens.SH_DEGREE},
    "coefficient-count": {tokens.SH_COEFFICIENTS},
    "element-size": {tokens.SH_COEFFICIENTS},
    "interpolation": {tokens.SH_COEFFICIENTS},
    "no-extent": {tokens.EXTENT},
}
"""Code of a finding -> attributes for which it violates the rule."""


def broken_rule(prim_type: str, attribute: str, code: str) -> str:
    """Return the rule that a finding violates; "" for none.

    Args:
        prim_type: Type of the prim.
        attribute: Attribute of the finding.
        code: Code of the finding.
    """
    is_judged = prim_type == tokens.STOCK_TYPE
    return RULE if is_judged and attribute in _BROKEN_BY.get(code, ()) else ""
