"""Tests of the layers of Cryptomatte, in scenes small enough to compute every number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import picture, random_cloud, view_of
from tests.render.surface_scenes import add
from tests.render.test_aovs import MIDDLE, ORDERS, eye, moved, splats, wall, weights_of
from usdsplat.images.cryptomatte import LAYERS, object_hash
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import FieldSpec, InstanceSpec, MaterialSpec

STACK = {
    "/a/x": (0.5, "/a", "/looks/red"),
    "/a/y": (0.2, "/a", ""),
    "/b/x": (0.5, "/b", "/looks/red"),
    "/b/y": (0.25, "", ""),
}
"""Splats on the axis, the nearest first: opacity, asset, material."""
LEFT = {"/a/x": 0.5, "/a/y": 0.1, "/b/x": 0.2, "/b/y": 0.05}
"""Coverage of each, by hand: 0.5; 0.5 * 0.2; 0.4 * 0.5; 0.2 * 0.25. 0.15 is let through."""


def put(scene: RenderScene, path: str, cloud, *places, asset: str = "", material: str = "") -> None:
    """Add a field, once for each matrix."""
    scene.set_field(path, FieldSpec(cloud=cloud))
    instances = (
        InstanceSpec(path=path, index=i, transform=tuple(m.ravel()), asset=asset, material=material)
        for i, m in enumerate(places or (np.eye(4),))
    )
    scene.set_instances(path, tuple(instances))


def stack() -> RenderScene:
    scene = RenderScene()
    for depth, (path, (opacity, asset, material)) in enumerate(STACK.items()):
        put(scene, path, splats([(0, 0, 0.2 * depth)], opacity), asset=asset, material=material)
    return scene


def pairs_at(mattes, place=MIDDLE) -> list[tuple[np.float32, float]]:
    """The (id, coverage) pairs of a pixel that are not empty."""
    ranks = mattes[place].reshape(-1, 2)
    return [(name, float(weight)) for name, weight in ranks if weight > 0]


def named(pairs) -> list[tuple[np.float32, object]]:
    """(name, coverage) as (id, coverage)."""
    return [(object_hash(name), pytest.approx(weight, abs=1e-6)) for name, weight in pairs]


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("sorting", ORDERS)
def test_each_layer_has_the_coverage_of_its_groups(sorting: str, samples: int) -> None:
    """Prims without an asset are their own, and those without a material are in the group default.
    Oracle: transmittances, worked out by hand."""
    view = view_of(eye())
    view = replace(view, camera=replace(view.camera, shutter=(0.0, 0.0)))
    options = {"sorting": sorting, "samples": samples, "filter_width": 1e-6 if samples > 1 else 0}
    found = picture(stack(), view, aovs=LAYERS, **options)
    objects = sorted(LEFT.items(), key=lambda item: -item[1])
    assert pairs_at(found["cryptoObject"]) == named(objects)
    assert pairs_at(found["cryptoAsset"]) == named([("/a", 0.6), ("/b", 0.2), ("/b/y", 0.05)])
    assert pairs_at(found["cryptoMaterial"]) == named([("/looks/red", 0.7), ("default", 0.15)])


@pytest.mark.parametrize("sorting", ORDERS)
def test_a_layer_alone_is_the_layer_beside_others(sorting: str) -> None:
    """Also with a matte and a wall. Oracle: the picture of all layers, bit for bit."""
    scene = add(stack(), "/wall", wall(0.3, half=0.7))
    view = replace(view_of(eye()), matte=(("/a/y", True),))
    all_of_them = picture(scene, view, sorting=sorting, aovs=(*LAYERS, "color", "depth"))
    for layer in LAYERS:
        alone = picture(scene, view, sorting=sorting, aovs=(layer,))[layer]
        assert alone.tobytes() == all_of_them[layer].tobytes()


@pytest.mark.parametrize("sorting", ORDERS)
@pytest.mark.parametrize("rank", [2, 5, 6, 16])
def test_groups_are_exact_however_few_ranks_there_are(sorting: str, rank: int) -> None:
    """Of twenty prims of four assets, in more prims than a pixel keeps. Oracle: the sums over the
    ranks of a picture in which each asset is one prim."""
    scene, merged = RenderScene(), RenderScene()
    parts = [random_cloud(seed, n=40, degree=0) for seed in range(20)]
    for i, cloud in enumerate(parts):
        big = replace(cloud, scales=2 * cloud.scales)
        put(scene, f"/set{i % 4}/prim{i:02d}", big, asset=f"/set{i % 4}")
        put(merged, f"/set{i % 4}/prim{i:02d}", big)
    view = view_of(eye())
    found = picture(scene, view, sorting=sorting, aovs=("cryptoAsset",), crypto_rank=rank)
    mattes = found["cryptoAsset"]
    assert mattes.shape[2] == 4 * ((rank + 1) // 2)
    whole = picture(merged, view, sorting=sorting, aovs=("cryptoObject",), crypto_rank=16)
    objects = whole["cryptoObject"]
    sums = np.stack(
        [
            sum(weights_of(objects, f"/set{s}/prim{i:02d}") for i in range(s, 20, 4))
            for s in range(4)
        ],
        axis=-1,
    )
    is_complete = objects[..., -1] == 0  # no prim was cut off
    assert is_complete.mean() > 0.5
    kept = min(2 * ((rank + 1) // 2), 4)
    expected = -np.sort(-sums, axis=-1)[is_complete][:, :kept]
    np.testing.assert_allclose(mattes[is_complete][:, 1::2][:, :kept], expected, atol=2e-6)
    assert not mattes[..., 1::2][..., 4:].any()


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("sorting", ORDERS)
def test_fewer_ranks_are_the_first_of_more(sorting: str, samples: int) -> None:
    """Oracle: the default of six, which all smaller numbers are accumulated with."""
    scene = RenderScene()
    for seed in range(8):
        put(scene, f"/prim{seed}", random_cloud(seed, n=60, degree=0))
    view, options = view_of(eye()), {"sorting": sorting, "samples": samples}
    six = picture(scene, view, aovs=("cryptoObject",), **options)["cryptoObject"]
    assert six.shape[2] == 12
    for rank in (2, 3, 4, 5):
        few = picture(scene, view, aovs=("cryptoObject",), crypto_rank=rank, **options)
        expected = six[..., : 4 * ((rank + 1) // 2)]
        assert few["cryptoObject"].tobytes() == expected.tobytes()


@pytest.mark.parametrize("samples", [1, 2])
def test_many_ranks_hold_many_prims(samples: int) -> None:
    """Fourteen prims that each cover a tenth of what is left. Oracle: 0.1 * 0.9^k."""
    scene = RenderScene()
    for k in range(14):
        put(scene, f"/prim{k:02d}", splats([(0, 0, 0.1 * k)], 0.1))
    view = view_of(eye())
    options = {"samples": samples, "filter_width": 1e-6 if samples > 1 else 0}
    for rank in (6, 16):
        found = picture(scene, view, aovs=("cryptoObject",), crypto_rank=rank, **options)
        expected = [(f"/prim{k:02d}", 0.1 * 0.9**k) for k in range(min(rank, 14))]
        assert pairs_at(found["cryptoObject"]) == named(expected)


@pytest.mark.parametrize("samples", [1, 3])
def test_faces_have_their_own_materials(samples: int) -> None:
    """A wall whose two triangles have two materials, beside another without any, behind a veil of
    splats with one of them. Oracle: the layer of objects, and the faces of the AOV of faces."""
    one = wall(0, half=1.0)
    materials = tuple(MaterialSpec(path=path) for path in ("/looks/red", "/looks/blue"))
    two = replace(one, materials=materials, material_of=np.int32([0, 1]))
    other = replace(one, materials=(MaterialSpec(),))
    scene = add(add(RenderScene(), "/wall", two), "/other", other, moved((3, 0, 0)))
    put(scene, "/veil", splats([(0, 0, -1)], 0.3, scales=(50.0,) * 3), material="/looks/red")
    view = view_of(eye())
    options = {"samples": samples, "filter_width": 1e-6 if samples > 1 else 0}
    found = picture(scene, view, aovs=(*LAYERS, "elementId"), **options)
    layer, objects = found["cryptoMaterial"], found["cryptoObject"]
    red, blue, default = (weights_of(layer, n) for n in ("/looks/red", "/looks/blue", "default"))
    by_wall, by_other = weights_of(objects, "/wall"), weights_of(objects, "/other")
    veil = weights_of(objects, "/veil")
    np.testing.assert_allclose(red + blue, by_wall + veil, atol=1e-6)
    np.testing.assert_allclose(default, by_other, atol=1e-6)
    if samples == 1:
        first = (found["elementId"] == 0) & (by_wall > 0) & (by_wall > veil)
        second = (found["elementId"] == 1) & (by_wall > 0) & (by_wall > veil)
        assert first.sum() > 50 and second.sum() > 50
        np.testing.assert_allclose(red[first], 1, atol=1e-3)
        np.testing.assert_allclose(blue[second], by_wall[second], atol=1e-6)
        np.testing.assert_allclose(blue[first], 0, atol=1e-6)
