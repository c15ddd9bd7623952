"""Take some of what is drawn of a scene as the subject of a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.quaternion import normalize, to_matrix
from usdsplat.render.cropping import inside
from usdsplat.render.fields import Field, Mesh
from usdsplat.render.lod.tree import Tree
from usdsplat.render.specs import CropSpec, InstanceSpec
from usdsplat.render.subject import MOST, Subject, corners, joined, of_points

FEWEST = 16
"""Least number of splats of an instance that are weighed; of some instances, if there are many."""
GOLDEN = (math.sqrt(5) - 1) / 2
"""Multiples of it, without their whole parts, are spread evenly over 0 to 1."""


def of_scene(
    fields: Sequence[Field],
    trees: Sequence[Tree],
    meshes: Sequence[Mesh],
    paths: tuple[str, ...] = (),
) -> Subject | None:
    """Return a sample of a scene: splats of fields and coarse trees, and points of meshes.

    Args:
        fields, trees, meshes: What is drawn.
        paths: Paths of the prims that count, with their descendants; empty for all.

    Returns:
        None if nothing is there.
    """
    parts = tuple(path.rstrip("/") for path in paths)

    def chosen(owner: Field | Tree | Mesh) -> list[InstanceSpec]:
        """Return the instances of a field, tree or mesh that count."""
        return [
            each
            for each in owner.instances
            if not paths or any(f"{each.path}/".startswith(f"{part}/") for part in parts)
        ]

    owners: list[Field | Tree] = [*fields, *trees]
    owners = [owner for owner in owners if chosen(owner)]
    count = sum(len(chosen(owner)) for owner in owners)
    splats = []
    for owner in owners:
        instances = chosen(owner)
        clouds = owner.coarsest() if isinstance(owner, Tree) else [owner.spec.cloud]
        if clouds:
            most = MOST * len(instances) // count
            splats.append(of_splats(clouds, instances, owner.crops, most=most))
    surfaces = (_of_mesh(mesh, found) for mesh in meshes if (found := chosen(mesh)))
    return joined([*splats, *surfaces])


def _of_mesh(mesh: Mesh, instances: Sequence[InstanceSpec]) -> Subject:
    """Return the points of a mesh; the corners of its boxes if there are many."""
    points = mesh.spec.points[np.isfinite(mesh.spec.points).all(axis=1)].astype(np.float64)
    if len(points) and len(points) * len(instances) > MOST:
        points = corners((points.min(axis=0), points.max(axis=0)))
    transforms = np.array([each.transform for each in instances]).reshape(-1, 4, 4)
    placed = np.einsum("kij,nj->kni", transforms[:, :3, :3], points) + transforms[:, None, :3, 3]
    return of_points(placed)


def of_splats(
    clouds: Sequence[SplatCloud],
    instances: Sequence[InstanceSpec],
    crops: tuple[CropSpec, ...],
    *,
    most: int,
) -> Subject:
    """Return some splats of instances of clouds that crops keep, evenly by their order.

    Args:
        clouds: Splats in local space.
        instances: Where they are.
        crops: Volumes in the world.
        most: About how many splats to take; of one instance `FEWEST`, even if these are more.
    """
    total = sum(map(len, clouds))
    every = len(instances)
    if every * min(FEWEST, total) > most:
        instances = _some(instances, max(1, most // FEWEST))
    step = max(1, total * len(instances) // max(most, FEWEST * len(instances)))
    few = [
        (cloud.positions[::step], cloud.rotations[::step], cloud.scales[::step],
         cloud.opacities[::step])
        for cloud in clouds
    ]  # fmt: skip
    local, turns, scales, opacities = (
        np.concatenate(each).astype(np.float64) for each in zip(*few, strict=True)
    )
    transforms = np.array([each.transform for each in instances]).reshape(-1, 4, 4)
    rotations = to_matrix(normalize(turns))
    with np.errstate(all="ignore"):  # what is not finite is left out below
        axes = np.swapaxes(rotations * scales[:, None, :], -1, -2)  # local, as rows
        placed = np.einsum("kij,nj->kni", transforms[:, :3, :3], local) + transforms[:, None, :3, 3]
        turned = np.einsum("kij,naj->knai", transforms[:, :3, :3], axes)
    centers, axes = placed.reshape(-1, 3), turned.reshape(-1, 3, 3)
    opacities = np.tile(opacities, len(transforms))
    kept = np.isfinite(centers).all(axis=1) & np.isfinite(axes).all(axis=(1, 2))
    kept &= opacities > 0
    if crops:
        kept &= inside(crops, centers)
    return Subject(
        centers=centers[kept],
        axes=axes[kept],
        opacities=np.minimum(opacities[kept], 1.0),
        counts=np.full(int(kept.sum()), step * every / len(instances)),
        owners=np.zeros(int(kept.sum()), np.int64),
        points=np.empty((0, 3)),
    )


def _some(instances: Sequence[InstanceSpec], count: int) -> list[InstanceSpec]:
    """Return one of each group of instances that are next to each other, `count` in all. Not the
    first of each: those of rows and columns would all be in the same place of their row."""
    edges = [len(instances) * k // count for k in range(count + 1)]
    parts = [(k * GOLDEN) % 1.0 for k in range(count)]
    return [
        instances[first + int(part * (last - first))]
        for first, last, part in zip(edges, edges[1:], parts, strict=False)
    ]
