"""A Skeleton as capsules: one from each joint to each of its children, one beyond each leaf."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from usdsplat.core.cloud import F64, I32, I64
from usdsplat.core.errors import StageError
from usdsplat.sim.parameters import AffectorParameters
from usdsplat.sim.specs import Solid
from usdsplat.sim.stage import spaces
from usdsplat.sim.stage.skeletons import Rigs, bind_transforms, joint_transforms, radii
from usdsplat.sim.stage.spaces import Space

_STEEPEST = 0.9
"""Largest difference of a bone's radii, as a fraction of its length: beyond it one end would
contain the other."""


class Bones:
    """The capsules of a Skeleton.

    A leaf's capsule continues its parent's bone by the same length, and rotates with the leaf. At
    each end a capsule has the radius of the joint there; a leaf's capsule has the leaf's at both.

    Authored radii are lengths in the prim's own space, like those of a Sphere.

    Args:
        prim: A Skeleton.
        space: The simulation's space.
        rigs: Skinning of the stage.
        asked: Names of the joints to use.

    Raises:
        StageError: If it has no joints, or lacks one that is asked for.
    """

    def __init__(self, prim: Usd.Prim, space: Space, rigs: Rigs, asked: AffectorParameters) -> None:
        self._prim, self._space = prim, space
        self._query = rigs.query(prim)
        names = [str(name) for name in self._query.GetJointOrder()]
        parents = np.array(self._query.GetTopology().GetParentIndices(), np.int64)
        bind = bind_transforms(self._query)
        first, second = _bones(parents)
        tips = _tips(parents, bind)
        ends = np.stack([bind[first, :3, 3], bind[second, :3, 3]], axis=1)
        leaf = first == second
        ends[leaf, 1] = tips[first[leaf]]
        self._radii = radii(rigs, prim, ends, first.astype(np.int32))
        kept = np.isin(first, _wanted(prim, names, asked.joints))
        self._first, self._second = first[kept], second[kept]
        ends = ends[kept]
        own = np.linalg.inv(bind[self._first])
        self._tips = np.einsum("bij,bj->bi", own[:, :3, :3], ends[:, 1]) + own[:, :3, 3]
        self._across = _across(bind[self._first], ends)

    def at(self, time: Usd.TimeCode, asked: AffectorParameters) -> tuple[Solid, ...]:
        """Return all capsules at a time."""
        matrix = self._space.from_prim(self._prim, time)
        joints = matrix @ joint_transforms(self._query, time)
        scale = spaces.size_of(matrix) * asked.radius_scale
        known = self._radii
        if asked.joint_radius >= 0:
            known = np.full_like(known, asked.joint_radius)
        solids = []
        for number, (first, second) in enumerate(zip(self._first, self._second, strict=True)):
            low, high = joints[first, :3, 3], joints[second, :3, 3]
            if first == second:
                high = joints[first, :3, :3] @ self._tips[number] + low
            side = joints[first, :3, :3] @ np.eye(3)[self._across[number]]
            length = float(np.linalg.norm(high - low))
            below = known[first] * scale
            above = np.clip(
                known[second] * scale, below - _STEEPEST * length, below + _STEEPEST * length
            )
            frame = spaces.placed(_frame(high - low, side), (low + high) / 2)
            size = (float(below), float(above), length / 2)
            solids.append(Solid(kind="capsule", matrix=frame, size=size))
        return tuple(solids)


def _bones(parents: I64) -> tuple[I64, I64]:
    """Return the joints at both ends of each bone, ordered by the first; a leaf's bone ends at
    itself."""
    count = len(parents)
    children = [(int(parents[joint]), joint) for joint in range(count) if parents[joint] >= 0]
    has_child = {first for first, _ in children}
    leaves = [(joint, joint) for joint in range(count) if joint not in has_child]
    pairs = np.array(sorted([*children, *leaves]), np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _tips(parents: I64, bind: F64) -> F64:
    """Return the point as far beyond each joint as its parent is before it, shape (j, 3); a root's
    own position."""
    at = bind[:, :3, 3]
    before = np.where(parents[:, None] >= 0, at[parents], at)
    return 2 * at - before


def _wanted(prim: Usd.Prim, names: list[str], asked: tuple[str, ...]) -> I32:
    """Return the joints that are asked for, by path or by name; all if none are."""
    found = []
    for name in asked:
        same = [i for i, each in enumerate(names) if name in (each, each.rpartition("/")[2])]
        if not same:
            where = f"{prim.GetPath()}.splatSim:affector:joints"
            raise StageError(where, f"the joint {name}", f"one of {', '.join(names[:8])}, ...")
        found += same
    return np.array(found if asked else range(len(names)), np.int32)


def _across(bind: F64, ends: F64) -> I64:
    """Return the axis of each bone's joint that is most perpendicular to the bone in the bind pose.
    A frame that keeps this axis does not spin about the bone."""
    along = ends[:, 1] - ends[:, 0]
    axes = bind[:, :3, :3] / np.maximum(np.linalg.norm(bind[:, :3, :3], axis=1), 1e-30)[:, None]
    return np.asarray(np.abs(np.einsum("bij,bi->bj", axes, along)).argmin(axis=1))


def _frame(along: F64, side: F64) -> F64:
    """Return the rotation that takes z along a bone and x towards `side`, projected perpendicular
    to it."""
    if not np.linalg.norm(along) > 0:
        along = np.cross(side, np.eye(3)[np.abs(side).argmin()])
    z = along / max(float(np.linalg.norm(along)), 1e-30)
    x = side - z * (side @ z)
    x = x / max(float(np.linalg.norm(x)), 1e-30)
    return np.stack([x, np.cross(z, x), z], axis=1)
