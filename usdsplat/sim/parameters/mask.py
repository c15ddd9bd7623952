"""SplatSimMaskAPI:<name>: a number for each splat that multiplies parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class MaskParameters:
    """One mask, SplatSimMaskAPI:<name>: a value of each splat, remapped; parameters of which
    splatSim:<parameter>:mask names it are multiplied by it, splat by splat."""

    source: Literal[
        "primvar", "affector", "noise", "axis", "u", "v", "age", "texture", "volume", "curves",
        "masks",
    ] = knob(
        "primvar",
        "value of a splat: a primvar of the field; the regions of affectors, 1 inside, fading over "
        "their falloff; noise, 0 to 1; the position along an axis [unit]; the pattern, u or v; age "
        "[s]; a texture that is projected; regions around the surface of an OpenVDB volume or "
        "around curves, 1 inside, fading over falloff; or other masks, combined",
        uniform=True,
    )  # fmt: skip
    primvar: str = knob("", "primvar of the field, float[], of source primvar", uniform=True)
    at: Literal["rest", "current"] = knob(
        "rest",
        "whether a mask in space moves with the splats, from where they are at rest, or stays "
        "where it is as they move; skin, deformers and target always use rest",
        uniform=True,
    )
    size: float = knob(
        1.0, "size of the patches of source noise", unit="unit", range=(1e-6, INF), uniform=True
    )
    speed: float = knob(
        0.0, "rate at which noise changes", unit="1/s", range=(0.0, INF), uniform=True
    )
    seed: int = knob(0, "seed of noise", range=(0, 2**31 - 1), uniform=True)
    axis: Literal["X", "Y", "Z"] = knob(
        "Y", "axis of the frame along which source axis measures", uniform=True
    )
    file: str = knob(
        "", "picture of source texture, or .vdb file of source volume", usd_type="asset",
        uniform=True,
    )  # fmt: skip
    grid: str = knob("", "grid of the .vdb file, a level set; empty is its only one", uniform=True)
    projection: Literal["planar", "spherical", "camera"] = knob(
        "planar",
        "projection of a texture from the frame: along z onto the square of edge 1 around the "
        "origin, from the origin onto a sphere, or through the lens of the frame, a Camera",
        uniform=True,
    )
    wrap: Literal["black", "clamp", "repeat"] = knob(
        "black", "value outside of the texture: 0, its nearest edge, or its repetition",
        uniform=True,
    )  # fmt: skip
    channel: Literal["luminance", "r", "g", "b", "a"] = knob(
        "luminance", "channel of the texture that is used", uniform=True
    )
    radius: float = knob(
        0.0,
        "distance from curves, or from the surface of a volume, within which the mask is 1",
        unit="unit",
        range=(-INF, INF),
    )
    falloff: float = knob(
        0.0, "further distance over which the mask of curves and volumes fades", unit="unit",
        range=(0.0, INF),
    )  # fmt: skip
    inputs: tuple[str, ...] = knob(
        (), "names of the masks of source masks", usd_type="token[]", uniform=True
    )
    operation: Literal["multiply", "max", "min", "add", "subtract"] = knob(
        "multiply", "combination of the inputs; subtract takes the others from the first",
        uniform=True,
    )  # fmt: skip
    in_min: float = knob(0.0, "value that becomes out_min", range=(-INF, INF))
    in_max: float = knob(1.0, "value that becomes out_max", range=(-INF, INF))
    ease: Literal["linear", "smooth", "smoother"] = knob(
        "linear", "shape of the ramp between in_min and in_max", uniform=True
    )
    clamp: bool = knob(
        True,
        "whether results stay between out_min and out_max; else a linear ramp goes on",
        uniform=True,
    )
    invert: bool = knob(False, "whether in_min becomes out_max, and in_max out_min", uniform=True)
    out_min: float = knob(0.0, "result at and below in_min", range=(-INF, INF))
    out_max: float = knob(1.0, "result at and above in_max", range=(-INF, INF))
