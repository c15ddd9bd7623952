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
    "noSplats": {tokens.POSITIONS},
    "missing": {*_SHAPE, tokens.SH_COEFFICIENTS},
    "halfOnly": _HALF,
    "tooShort": _SHAPE,
    "tooLong": _SHAPE,
    "zeroScale": {tokens.SCALES},
    "negativeScale": {tokens.SCALES},
    "opacityRange": {tokens.OPACITIES},
    "notUnit": {tokens.ORIENTATIONS},
    "degree": {tokens.SH_DEGREE},
    "interchangeDegree": {tokens.SH_DEGREE},
    "coefficientCount": {tokens.SH_COEFFICIENTS},
    "elementSize": {tokens.SH_COEFFICIENTS},
    "interpolation": {tokens.SH_COEFFICIENTS},
    "noExtent": {tokens.EXTENT},
}
"""Name of a finding -> attributes for which it violates the rule."""


def broken_rule(prim_type: str, attribute: str, name: str) -> str:
    """Return the rule that a finding violates; "" for none.

    Args:
        prim_type: Type of the prim.
        attribute: Attribute of the finding.
        name: Name of the finding.
    """
    is_judged = prim_type == tokens.STOCK_TYPE
    return RULE if is_judged and attribute in _BROKEN_BY.get(name, ()) else ""
