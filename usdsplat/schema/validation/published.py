"""Which findings break a rule that somebody published for assets of splats.

NVIDIA's VG.035 looks at prims of the stock type: they must have the float attributes and an extent,
lengths that match, scales above 0, opacities from 0 to 1, quaternions of length 1, a degree from 0
to 3, and harmonics whose metadata say so. Packed fields are none of its business.

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
"""Name of a finding -> the attributes with which it breaks the rule."""


def broken_rule(prim_type: str, attribute: str, name: str) -> str:
    """The rule that a finding breaks; "" for none.

    Args:
        prim_type: Of the prim that it is about.
        attribute: What it is about.
        name: Of the finding.
    """
    is_judged = prim_type == tokens.STOCK_TYPE
    return RULE if is_judged and attribute in _BROKEN_BY.get(name, ()) else ""
