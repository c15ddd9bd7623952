"""Decide what a bake writes about one field, before its first frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError, UsageError
from usdsplat.schema import packed, proxy, stock, tokens
from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage.spool import SpoolOptions
from usdsplat.sim.stage.trees import is_simulated, replaced_root

ARRAYS = {
    "positions": tokens.POSITIONS,
    "rotations": tokens.ORIENTATIONS,
    "scales": tokens.SCALES,
    "opacities": tokens.OPACITIES,
    "sh": tokens.SH_COEFFICIENTS,
}
"""Array of a cloud -> the stock attribute."""
HARMONICS = 1 / 512
"""Change of a coefficient from which it is written, in mode edit."""
_NEAREST = 64


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BakedField:
    """A simulated field."""

    path: str
    """Path on the stage."""
    rest: SplatCloud
    """The capture, as `schema.fetch` reads it."""
    writes: frozenset[str]
    """Arrays of the cloud that the simulation changes, of ARRAYS; others are not written."""
    is_fixed: bool
    """Whether no splat can be born or die."""
    rasterize_mode: str = ""
    """Of a cut of a splat tree; "" for a field."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plan:
    """Attributes and precision that a bake writes for one field."""

    path: str
    rest: SplatCloud
    names: dict[str, str]
    """Arrays of the cloud that are written -> attributes."""
    retype: str
    """Type that the layer gives the prim, or an empty string."""
    is_packed: bool
    proxy: str | None
    """Path of the proxy that a packed bake writes; None if it writes none."""
    rasterize_mode: str
    """Mode that replaces that of a splat tree; "" for a field."""
    degree: int
    """Degree of the harmonics that replaces that of the field; negative keeps it."""
    lod_root: str
    """Path of the LOD root that the tree stands for, or an empty string."""
    ids: bool
    """Whether a fixed population needs its ids written."""
    block_velocities: bool
    """Whether the capture's velocities no longer apply."""
    is_imageable: bool
    """Whether the field's purpose is the default one."""
    epsilon: dict[str, float]
    """Arrays of the cloud -> tolerance below which a change is not written, in mode edit."""
    keeping: SpoolOptions

    @property
    def moves(self) -> bool:
        """Whether the extent changes."""
        return bool({"positions", "rotations", "scales"} & set(self.names))


def plan(stage: Usd.Stage, field: BakedField, parameters: BakeParameters) -> Plan:
    """Decide what is written about a field.

    Raises:
        StageError: If the prim cannot be written, or not in this mode.
        UsageError: If `writes` names something else.
    """
    prim = stage.GetPrimAtPath(field.path)
    _check(prim, field, parameters)
    is_packed = parameters.mode == "packed"
    form = schema.form_of(prim)
    retype = tokens.PACKED_TYPE if is_packed and form != "packed" else ""
    if not is_packed and (form == "packed" or schema.is_tree(prim)):
        retype = tokens.STOCK_TYPE
    is_whole = is_packed or bool(retype) or not field.is_fixed
    writes = set(ARRAYS) if is_whole else set(field.writes)
    names = {each: attribute_of(prim, each, parameters.mode) for each in ARRAYS if each in writes}
    velocities = "positions" in writes and parameters.velocities and parameters.mode != "edit"
    half = any(name in tokens.HALF_OF.values() for name in names.values())
    known = prim.GetAttribute(tokens.IDS)
    return Plan(
        path=field.path,
        rest=field.rest,
        names=names,
        retype=retype,
        is_packed=is_packed,
        proxy=_proxy(prim) if is_packed else None,
        rasterize_mode=field.rasterize_mode,
        degree=_degree(prim, field.rest, is_whole=bool(retype)),
        lod_root=replaced_root(prim) if schema.is_tree(prim) else "",
        ids=field.is_fixed and parameters.mode != "edit" and not (known and known.HasValue()),
        block_velocities="positions" in writes and not velocities and _has_velocities(prim),
        is_imageable=_purpose(prim) == "default",
        epsilon=_epsilon(field.rest, parameters) if parameters.mode == "edit" else {},
        keeping=SpoolOptions(
            arrays=tuple(name for name in names if name != "sh"),
            harmonics="sh" in field.writes,
            is_whole=is_whole,
            rate_sh=1 if is_packed and parameters.rate_sh < 0 else parameters.rate_sh,
            epoch=parameters.clip_frames,
            is_fixed=field.is_fixed,
            velocities=velocities,
            pattern=parameters.pattern,
            slack=packed.SLACK if is_packed else stock.HALF_SLACK if half else 0.0,
        ),
    )


def _check(prim: Usd.Prim, field: BakedField, parameters: BakeParameters) -> None:
    """Reject fields that cannot be baked."""
    where = field.path
    if not is_simulated(prim):
        raise StageError(where, "no splat field", "a splat field to bake")
    if prim.IsInstanceProxy() or prim.IsInPrototype() or prim.IsInstance():
        raise StageError(where, "an instance", "a prim that can be edited")
    if not field.writes <= set(ARRAYS):
        found = ", ".join(sorted(field.writes - set(ARRAYS)))
        raise UsageError("writes", found, f"some of {', '.join(ARRAYS)}")
    ids = field.rest.ids
    if not field.is_fixed and ids is not None and (np.diff(ids) <= 0).any():
        raise StageError(f"{where}.ids", "ids out of order", "ascending ones, or no births")
    if parameters.mode == "edit":
        if Usd.GetVersion() < (0, 26, 3):
            found = "usd-core " + ".".join(str(each) for each in Usd.GetVersion()[1:])
            raise StageError("bake:mode edit", found, "26.3 or later")
        if not field.is_fixed:
            found = "splats that are born, die, are divided, or fill broken pieces (matter:fill)"
            raise StageError(f"{where}, bake:mode edit", found, "the same splats at all frames")
        if schema.is_tree(prim):
            raise StageError(f"{where}, bake:mode edit", "a splat tree", "a stock field")
        if schema.form_of(prim) == "packed":
            raise StageError(f"{where}, bake:mode edit", "a packed field", "a stock one")


def attribute_of(prim: Usd.Prim, array: str, mode: str) -> str:
    """Return the attribute that holds an array of ARRAYS in the precision of the capture, in a
    bake's mode."""
    name = ARRAYS[array]
    if schema.is_packed(prim) or (array == "positions" and mode != "edit"):
        return name  # half positions cost up to 27 dB, and float ones take precedence
    return stock.source_name(prim, name)


def _degree(prim: Usd.Prim, rest: SplatCloud, *, is_whole: bool) -> int:
    """Return the degree of the harmonics if the layer must give it."""
    known = prim.GetAttribute(tokens.SH_DEGREE)
    own = known.Get() if known else None
    return rest.sh_degree if is_whole or (own or 0) < rest.sh_degree else -1


def _has_velocities(prim: Usd.Prim) -> bool:
    attribute = prim.GetAttribute(tokens.VELOCITIES)
    return bool(attribute) and bool(attribute.HasAuthoredValue())


def _proxy(prim: Usd.Prim) -> str | None:
    path = proxy.path_of(prim)
    return None if path is None else str(path)


def _purpose(prim: Usd.Prim) -> str:
    return str(UsdGeom.Imageable(prim).ComputePurpose())


def _epsilon(rest: SplatCloud, parameters: BakeParameters) -> dict[str, float]:
    """Return tolerances: positions [unit], rotations [radian], scales relative, others absolute."""
    return {
        "positions": parameters.position_epsilon * _spacing(rest),
        "rotations": math.radians(parameters.rotation_epsilon),
        "scales": parameters.scale_epsilon,
        "opacities": parameters.opacity_epsilon,
        "sh": HARMONICS,
    }


def _spacing(cloud: SplatCloud) -> float:
    """Return the mean distance to the nearest neighbour, of a sample of splats spread over the
    rows."""
    n = len(cloud)
    if n < 2:
        return 0.0
    found = []
    for row in np.unique(np.linspace(0, n - 1, _NEAREST).astype(np.int64)):
        away = cloud.positions - cloud.positions[row]
        squared = np.einsum("ni,ni->n", away, away)
        squared[row] = np.inf
        found.append(float(np.sqrt(squared.min())))
    return float(np.mean(found))
