"""Find assets that are referenced with another unit or up axis than their stage has.

USD does not convert them. A transform that does, on the prim of the arc or above, is recognised: by
its scale or rotation, or by the ops that metrics assemblers write, such as
`xformOp:scale:unitsResolve`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from pxr import Pcp, Sdf, Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.schema.stage_values import UP_AXES, local_transform, op_names

RESOLVED = "unitsResolve"
"""Suffix of the ops of metrics assemblers."""
TOLERANCE = 0.01
"""Relative tolerance of the scale, and tolerance of the cosine of the up axis."""

_UNIT, _AXIS = UsdGeom.Tokens.metersPerUnit, UsdGeom.Tokens.upAxis
_ARCS = (Pcp.ArcTypeReference, Pcp.ArcTypePayload)


def metrics_findings(stage: Usd.Stage, prims: Iterable[Usd.Prim]) -> Iterator[Finding]:
    """Yield a finding for each referenced asset whose authored unit or up axis is another than that
    of the layer that refers to it, unless a transform corrects it.

    Args:
        stage: The stage.
        prims: Its prims, see `in_world`.
    """
    layers = [layer.pseudoRoot for layer in stage.GetUsedLayers(False)]
    varies = [
        name
        for name in (_UNIT, _AXIS)
        if len({root.GetInfo(name) for root in layers if root.HasInfo(name)}) > 1
    ]
    if not varies:
        return
    for prim in prims:
        if prim.HasAuthoredReferences() or prim.HasAuthoredPayloads():
            yield from _of_prim(prim, varies)


def _of_prim(prim: Usd.Prim, names: list[str]) -> Iterator[Finding]:
    """Yield the findings on the direct references and payloads of a prim."""
    for arc in Usd.PrimCompositionQuery(prim).GetCompositionArcs():
        if arc.GetArcType() not in _ARCS or arc.IsAncestral():
            continue
        asset = _root_layer(arc.GetTargetNode())
        shot = _root_layer(arc.GetIntroducingNode())
        differing = [name for name in names if _differs(name, asset, shot)]
        if not differing or not _has_size(prim):
            continue
        ops, places = _transforms(prim)
        if _UNIT in differing and not (
            any("scale" in op and RESOLVED in op for op in ops)
            or any(_scales(place, _ratio(asset, shot)) for place in places)
        ):
            found = f"{asset.GetDisplayName()} with a metersPerUnit of {_unit(asset):g}"
            expected = f"{_unit(shot):g}, or a scale of {_ratio(asset, shot):g}"
            yield finding("units-mismatch", str(prim.GetPath()), found, expected)
        if _AXIS in differing and not (
            any("rotate" in op and RESOLVED in op for op in ops)
            or any(_turns(place, _axis(asset), _axis(shot)) for place in places)
        ):
            found = f"{asset.GetDisplayName()} with the upAxis {_axis(asset)}"
            expected = f"{_axis(shot)}, or a rotation by 90 degrees about X"
            yield finding("axes-mismatch", str(prim.GetPath()), found, expected)


def _root_layer(node: Pcp.NodeRef) -> Sdf.Layer:
    return node.layerStack.identifier.rootLayer


def _differs(name: str, asset: Sdf.Layer, shot: Sdf.Layer) -> bool:
    """Return whether both layers author a metadatum, with different values that USD allows."""
    roots = (asset.pseudoRoot, shot.pseudoRoot)
    if name == _AXIS and not {_axis(asset), _axis(shot)} <= set(UP_AXES):
        return False
    return all(root.HasInfo(name) for root in roots) and (
        roots[0].GetInfo(name) != roots[1].GetInfo(name)
    )


def _unit(layer: Sdf.Layer) -> float:
    return float(layer.pseudoRoot.GetInfo(_UNIT))


def _axis(layer: Sdf.Layer) -> str:
    return str(layer.pseudoRoot.GetInfo(_AXIS))


def _ratio(asset: Sdf.Layer, shot: Sdf.Layer) -> float:
    """Return the scale that converts lengths of the asset to those of the shot."""
    return _unit(asset) / _unit(shot) if _unit(shot) else np.inf


def _has_size(prim: Usd.Prim) -> bool:
    """Return whether there is something with a size at or below a prim."""
    below = Usd.PrimRange(prim, Usd.TraverseInstanceProxies())
    return any(each.IsA(UsdGeom.Boundable) for each in below)


def _transforms(prim: Usd.Prim) -> tuple[list[str], list[F64]]:
    """Return the names of the ops of a prim and its ancestors, and the linear parts of its matrices
    to each of its ancestors, shape (3, 3), for row vectors."""
    ops: list[str] = []
    places: list[F64] = []
    place = np.eye(3)
    while prim and not prim.IsPseudoRoot():
        ops += op_names(prim)
        try:
            matrix = local_transform(prim, Usd.TimeCode.EarliestTime())
        except StageError:  # reported where the prim is drawn
            break
        place = place @ np.array(matrix)[:3, :3]
        places.append(place)
        prim = prim.GetParent()
    return ops, places


def _scales(place: F64, ratio: float) -> bool:
    lengths = np.linalg.norm(place, axis=1)
    return bool(np.allclose(lengths, ratio, rtol=TOLERANCE, atol=0.0))


def _turns(place: F64, axis: str, wanted: str) -> bool:
    """Return whether a matrix turns one axis to another."""
    if axis not in "XYZ" or wanted not in "XYZ":
        return False
    up = place["XYZ".index(axis)]
    length = float(np.linalg.norm(up))
    return length > 0 and float(up["XYZ".index(wanted)]) > (1 - TOLERANCE) * length
