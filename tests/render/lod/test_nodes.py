"""Tests of drawn cuts: equality with fields, ids, levels, fading, and what acts on the prim."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from tests.render.lod.drawn import drawn_counts, drawn_nodes
from tests.render.lod.trees import OF_SURFACES, Made, made
from tests.render.rendering import (
    lens,
    picture,
    random_cloud,
    random_transform,
    settings_of,
    view_of,
)
from usdsplat.core.errors import StageError
from usdsplat.kernels.devices import open_device
from usdsplat.render.lod.cut import FADE, RAMP
from usdsplat.render.lod.nodes import nodes_of
from usdsplat.render.renderer import AOVS, Renderer
from usdsplat.render.sampling import Sample
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CropSpec, FieldSpec, InstanceSpec

PLACED = InstanceSpec(path="/tree", transform=tuple(np.eye(4).ravel()))


def tree_scene(tree, *instances, crops=(), **options):
    scene = RenderScene()
    scene.set_tree("/tree", tree.spec(**options))
    scene.set_instances("/tree", instances or (PLACED,))
    if crops:
        scene.set_crops("/tree", crops)
    return scene


def field_scene(tree, *instances, crops=(), **options):
    """The leaves and residents of a tree as a field."""
    scene = RenderScene()
    scene.set_field("/tree", FieldSpec(cloud=tree.leaves(), **options))
    scene.set_instances("/tree", instances or (PLACED,))
    if crops:
        scene.set_crops("/tree", crops)
    return scene


def assert_same(found, expected):
    """All AOVs but those of surfaces, which trees do not have."""
    for name in expected.keys() - OF_SURFACES:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


@pytest.mark.parametrize("strays", [0, 5])
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
@pytest.mark.parametrize("model", ["perspective", "orthographic"])
def test_a_cut_of_leaves_is_the_field_bit_for_bit(model, mode, strays):
    """Oracle: the same splats as a field, in every AOV, with equal depths among them."""
    tree = made(1, strays=strays)
    tree.clouds[5].positions[:] = np.round(tree.clouds[5].positions, 1)  # ties
    tree.clouds[6].positions[:] = np.round(tree.clouds[6].positions, 1)
    view = view_of(lens(model))
    found = picture(tree_scene(tree, rasterize_mode=mode), view, lod_error=0)
    assert_same(found, picture(field_scene(tree, rasterize_mode=mode), view))
    assert (found["primId"] >= 0).any() and found["elementId"].max() > 100


@pytest.mark.parametrize("sorting", ["cameraDistance", "rayHitDistance"])
def test_other_orders_are_those_of_the_field(sorting):
    """Oracle: as above."""
    tree, view = made(2), view_of(lens())
    found = picture(tree_scene(tree), view, lod_error=0, sorting=sorting)
    assert_same(found, picture(field_scene(tree), view, sorting=sorting))


def test_instances_crops_mattes_and_blur_act_as_on_a_field():
    """Oracle: the same splats as a field with instances, a crop, a matte and samples."""
    tree = made(3)
    instances = tuple(
        InstanceSpec(path="/tree", index=i, transform=tuple(random_transform(i).ravel()))
        for i in range(3)
    )
    crops = (CropSpec(shape="sphere", world_to_shape=tuple(np.eye(4).ravel()), keeps=True),)
    view = view_of(lens())
    aovs = ("color", "albedo", "cryptoObject", "primId", "instanceId", "elementId")
    settings = {"aovs": aovs, "samples": 3}
    found = picture(tree_scene(tree, *instances, crops=crops), view, lod_error=0, **settings)
    assert_same(found, picture(field_scene(tree, *instances, crops=crops), view, **settings))
    held = replace(view, matte=(("/tree", True),))
    assert picture(tree_scene(tree), held, aovs=("color",), lod_error=0)["color"].max() == 0


def test_a_crop_of_the_picture_has_the_pixels_of_the_whole():
    """Oracle: the same pixels of the whole picture, at a cut with inner nodes."""
    tree = made(4, leaf=10, error=0.05)
    whole = picture(tree_scene(tree), view_of(lens()), lod_error=2.0)
    part = picture(tree_scene(tree), view_of(lens(), (30, 21, 97, 90)), lod_error=2.0)
    for name in AOVS:
        np.testing.assert_array_equal(part[name], whole[name][21:90, 30:97], err_msg=name)


def test_a_crop_has_what_samples_of_a_wide_filter_show():
    """Oracle: the same pixels of the whole picture. Samples of coarse levels are farther from the
    pixel than the two samples of the plan."""
    cloud = random_cloud(4, 800, 0)
    cloud.positions[:] *= (0.5, 0.5, 0.001)
    cloud.scales[:], cloud.opacities[:] = 0.004, 0.99
    tree = Made(cloud, leaf=1)
    settings = {"lod_error": 1.0, "samples": 2, "lod_samples": 6, "aovs": ("color",)}
    settings |= {"pixel_filter": "box", "filter_width": 16.0}
    whole = picture(tree_scene(tree, degree=0), view_of(lens()), **settings)["color"]
    found = picture(tree_scene(tree, degree=0), view_of(lens(), (40, 31, 50, 40)), **settings)
    np.testing.assert_array_equal(found["color"], whole[31:40, 40:50])


def test_a_coarse_cut_draws_the_proxies_antialiased_with_samples():
    """Oracle: the mean of antialiased pictures of the root's proxies as a field, at n times the
    resolution, where one pixel is one sample, and with half of the low-pass."""
    n = 3
    tree = made(5, error=1e-3)
    spec = tree.spec()
    proxies = spec.load(0, 0, int(tree.table.proxies[0]))
    view = view_of(lens())
    found = picture(tree_scene(tree), view, aovs=("color",), lod_error=1000.0, lod_samples=n)
    scene = RenderScene()
    scene.set_field("/tree", FieldSpec(cloud=proxies, rasterize_mode="antialiased"))
    scene.set_instances("/tree", (PLACED,))
    width, height = view.framing.resolution
    fine = replace(
        view, framing=replace(view.framing, resolution=(n * width, n * height), pixel_scale=2**0.5)
    )
    drawn = picture(scene, fine, aovs=("color",))["color"]
    mean = drawn.reshape(height, n, width, n, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(found["color"], mean, atol=2e-3)
    assert np.abs(found["color"] - mean).mean() < 2e-5
    assert tree.reads[-1] == (0, 0, len(proxies))


@pytest.mark.parametrize("samples", [1, 2])
def test_a_node_fades_into_its_children(samples):
    """Oracle: pictures of the root and of its children. Between, the picture is nearly their mean
    with the weights that the distance says: each sample begins slowly, after the one before."""
    tree = made(6, leaf=250, error=0.05)
    assert len(tree.table) == 3
    view = view_of(lens("orthographic"))
    size = 22.0 * float(tree.table.errors[0])  # of the error on the screen [pixel]
    settings = {"aovs": ("color",), "lod_samples": samples}
    coarse = picture(tree_scene(tree), view, lod_error=size * 1.001, **settings)["color"]
    fine = picture(tree_scene(tree), view, lod_error=size / (1.01 * FADE), **settings)["color"]
    before, largest = coarse, np.abs(fine - coarse).max()
    for part in (np.arange(21) / 20).tolist():
        error = size / FADE**part
        found = picture(tree_scene(tree), view, lod_error=error, **settings)["color"]
        whole, begun = divmod(part * samples**2, 1)
        weight = (whole + np.expm1(RAMP * begun) / np.expm1(RAMP)) / samples**2
        mixed = (1 - weight) * coarse + weight * fine
        assert np.abs(found - mixed).mean() < (0.2 / samples) * np.abs(fine - coarse).mean()
        assert np.abs(found - before).max() < 0.16 * largest
        before = found
    assert np.array_equal(before, fine)
    assert largest > 0.05


@pytest.mark.parametrize("fade", [(0.0, 1.0), (0.25, 0.5), (0.0, 0.0), (1.0, 1.0)])
def test_weights_of_a_leaf_and_of_the_nodes_above_add_up_to_one(fade):
    """Oracle: the definition of a cut, also where three levels or more are faded at once: here
    their errors are 22 pixels times 0.02, 0.026 and 0.034."""
    tree, view = made(6, leaf=10, error=0.02), view_of(lens("orthographic"))
    scene, parents = tree_scene(tree), tree.table.parents()
    settings = settings_of(lod_error=22 * 0.0197)
    nodes = nodes_of(scene, lambda _: (scene, view), settings, (Sample(),))
    layout = nodes.layout(scene, fade)
    weights = dict.fromkeys(range(len(parents)), 0.0)
    drawn = [int(name.split(":")[1]) for name, _, _ in nodes.drawn(scene)]
    weights |= dict(zip(drawn, layout.weights.tolist(), strict=True))
    most = 0
    for leaf in set(drawn) & set(np.flatnonzero(tree.table.child_count == 0).tolist()):
        path = [leaf]
        while parents[path[-1]] >= 0:
            path.append(int(parents[path[-1]]))
        assert sum(weights[node] for node in path) == pytest.approx(1, abs=1e-4)
        most = max(most, sum(weights[node] > 0 for node in path))
    assert most >= 3 if fade == (0.0, 1.0) else most >= 1


def test_ids_of_all_nodes_are_one_prim_and_distinct_elements():
    """Oracle: element ids by hand: captured splats by node, then proxies by node."""
    tree = made(7, strays=4)
    elements = tree.spec().first_elements()
    table = tree.table
    leaf = np.flatnonzero(table.child_count == 0)
    assert elements[0, 0] == 0 and elements[0, leaf[0]] == 4
    assert elements[0, leaf[1]] == 4 + table.proxies[leaf[0]]
    assert elements[1, 0] == 4 + table.proxies[leaf].sum()
    assert elements[1, 1] == elements[1, 0] + table.proxies[0]
    scene = tree_scene(tree)
    scene.set_field("/a", FieldSpec(cloud=made(8).leaves()))
    scene.set_instances("/a", (InstanceSpec(path="/a", transform=PLACED.transform),))
    found = picture(scene, view_of(lens()), lod_error=1000.0)
    assert set(np.unique(found["primId"])) == {-1, 0, 1}
    of_tree = found["elementId"][found["primId"] == 1]
    proxies = of_tree >= elements[1, 0]
    assert proxies.any() and (of_tree[~proxies] < 4).all()
    assert of_tree.max() < elements[1, 0] + table.proxies[0]
    assert (of_tree < 4).any()  # residents of the root, whose proxies are drawn too
    for name in ("motionForward", "motionBackward"):
        assert np.abs(found[name]).max() < 1e-4  # nothing moves
    assert scene.prims() == ("/a", "/tree")


def test_trees_coarsen_before_fields_lose_splats():
    """Oracle: the counts. The budget holds the whole field, so the tree gets what is left."""
    tree, other = made(9, leaf=10), made(10)
    field = other.leaves()
    scene = tree_scene(tree)
    scene.set_field("/a", FieldSpec(cloud=field))
    scene.set_instances("/a", (InstanceSpec(path="/a", transform=PLACED.transform),))
    counts = drawn_counts(scene, view_of(lens()), splat_budget=len(field) + 320, lod_error=0.01)
    assert counts["/a"] == len(field) and 200 < counts["/tree"] <= 320
    root = int(tree.table.proxies[0])
    counts = drawn_counts(scene, view_of(lens()), splat_budget=root + 40, lod_error=0.01)
    assert counts == {"/a": 40, "/tree": root}


def test_only_what_a_view_can_see_is_read():
    """Oracle: a view of one end of the tree reads no leaf that lies at the other."""
    tree = made(11, n=2000, leaf=20)
    view = view_of(lens(), (0, 0, 40, 110))
    picture(tree_scene(tree), view, aovs=("color",), lod_error=0)
    read = {chunk for chunk, _, _ in tree.reads}
    leaves = np.flatnonzero(tree.table.child_count == 0)
    assert 0 < len(read) < 0.7 * len(leaves)


def test_a_chunk_that_is_missing_leaves_its_parent():
    """Oracle: the picture of a tree in which that node's parent is a leaf with its proxies."""
    tree = made(12, leaf=60)
    whole = tree.load

    def load(chunk, first, count):
        if chunk == 7:
            raise StageError("chunk 7", "no such file", "a layer")
        return whole(chunk, first, count)

    scene = tree_scene(tree, load=load)
    nodes = drawn_nodes(scene, view_of(lens()), lod_error=0)
    assert 3 in nodes and not {7, 8} & nodes and {9, 10} <= nodes
    ((_, held),) = scene.drawn_trees()
    assert str(held.problems[7]) == "chunk 7: found no such file, expected a layer"


def test_the_nearest_node_with_proxies_stands_for_one_that_is_missing():
    """Oracle: by hand. The parent of the missing leaf has no proxies, so the root is drawn."""
    tree = made(12, leaf=120)
    assert tree.table.first_child.tolist() == [1, 3, 5, 0, 0, 0, 0]
    tree.table.proxies[1], tree.table.errors[:2] = 0, np.inf
    tree.table.errors[0] = 3.0e38
    whole = tree.load

    def load(chunk, first, count):
        if chunk == 3:
            raise StageError("chunk 3", "no such file", "a layer")
        return whole(chunk, first, count)

    scene = tree_scene(tree, load=load)
    assert drawn_nodes(scene, view_of(lens()), lod_error=0) == {0}


def test_pictures_of_two_views_have_a_cut_each():
    """Oracle: each view alone, in a scene of its own."""
    tree = made(13, leaf=10)
    near, far = view_of(lens()), view_of(lens("orthographic"))
    scene = tree_scene(tree)
    for view in (near, far, near, far):
        alone = picture(tree_scene(tree), view, lod_error=1.5)
        assert_same(picture(scene, view, lod_error=1.5), alone)


def test_motion_of_a_moved_tree_is_that_of_a_field():
    """Oracle: the same splats as a field that moves in the same way."""
    tree, view = made(14), view_of(lens())
    aovs = ("motionForward", "motionBackward", "depth")

    def moving(scene):
        def sampler(time):
            matrix = np.eye(4)
            matrix[0, 3] = 0.05 * time
            moved = InstanceSpec(path="/tree", transform=tuple(matrix.ravel()))
            scene.set_instances("/tree", (moved,))
            return scene, view

        return sampler

    a, b = tree_scene(tree), field_scene(tree)
    found = picture(a, view, aovs=aovs, sampler=moving(a), lod_error=0)
    assert_same(found, picture(b, view, aovs=aovs, sampler=moving(b)))
    assert np.isfinite(found["depth"]).any()


@pytest.mark.parametrize("samples", [1, 3])
def test_everything_else_is_drawn_as_without_coarse_levels(samples):
    """Oracle: the field and the crypto layer of a picture without the tree, which is elsewhere."""
    tree, field = made(15), made(16).leaves()
    aside = np.diag([0.4, 0.4, 0.4, 1.0])
    aside[0, 3] = 1.9
    away = InstanceSpec(path="/tree", transform=tuple(aside.ravel()))
    both, alone = tree_scene(tree, away), RenderScene()
    for scene in (both, alone):
        scene.set_field("/a", FieldSpec(cloud=field))
        matrix = np.diag([0.3, 0.3, 0.3, 1.0])
        scene.set_instances("/a", (InstanceSpec(path="/a", transform=tuple(matrix.ravel())),))
    view = view_of(lens())
    settings = {"aovs": ("color", "albedo"), "samples": samples}
    found = picture(both, view, lod_error=1000.0, lod_samples=4, **settings)
    expected = picture(alone, view, **settings)
    assert found["color"][:, 110:, 3].max() > 0.5  # the tree
    for name, array in expected.items():
        np.testing.assert_allclose(found[name][:, :85], array[:, :85], atol=1e-6)


def test_coarse_levels_are_averaged_in_the_blend_space():
    """Oracle: the display picture, unpremultiplied and converted by the sRGB curve; averaging light
    would be brighter."""
    tree = made(17, n=4000)
    view = view_of(lens())
    settings = {"aovs": ("color",), "lod_error": 1000.0, "lod_samples": 4}
    shown = picture(tree_scene(tree), view, **settings)["color"]
    linear = picture(tree_scene(tree), view, color_mode="scene", **settings)["color"]
    seen = shown[..., 3] > 0.3
    assert seen.sum() > 1000
    encoded, alpha = shown[seen][:, :3] / shown[seen][:, 3:], shown[seen][:, 3:]
    expected = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear[seen][:, :3], alpha * expected, atol=1e-5)


def test_deep_samples_of_leaves_are_those_of_the_field():
    """Oracle: the same splats as a field, with ids."""
    tree, view = made(18), view_of(lens())
    names = ("primId", "elementId")

    def deep(scene, **settings):
        renderer = Renderer(open_device())
        strips = renderer.render_deep(scene, view, settings_of(**settings), names)
        return [(each.depth.copy(), each.color.copy(), each.ids.copy()) for _, _, each in strips]

    for found, expected in zip(
        deep(tree_scene(tree), lod_error=0), deep(field_scene(tree)), strict=True
    ):
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_array_equal(a, b)


def test_without_waiting_the_nearest_level_in_memory_is_drawn():
    """Oracle: pictures at cuts that are chosen by hand. The root must be read at first; leaves that
    are not read are replaced by it, and never leave a hole."""
    tree = made(19, leaf=110)
    allowed = threading.Event()

    def load(chunk, first, count):
        if chunk > 0:
            assert allowed.wait(20)
        return tree.load(chunk, first, count)

    scene, view = tree_scene(tree, load=load), view_of(lens())
    settings = {"aovs": ("color",), "lod_samples": 1}
    soon = picture(scene, view, lod_error=0.0, node_wait=False, **settings)["color"]
    whole = tree_scene(tree)
    root = picture(whole, view, lod_error=1000.0, **settings)["color"]
    np.testing.assert_array_equal(soon, root)
    allowed.set()
    found = picture(scene, view, lod_error=0.0, **settings)["color"]
    np.testing.assert_array_equal(found, picture(whole, view, lod_error=0.0, **settings)["color"])
    again = picture(scene, view, lod_error=0.0, node_wait=False, **settings)["color"]
    np.testing.assert_array_equal(again, found)


def test_motion_blur_of_a_moving_tree_is_that_of_a_field():
    """Oracle: the same splats as a field that moves in the same way; the tree begins out of view,
    so nodes of all samples must be found."""
    tree = made(20)
    view = view_of(lens())
    view = replace(view, camera=replace(view.camera, shutter=(0.0, 1.0)))

    def moving(scene):
        def sampler(time):
            matrix = np.eye(4)
            matrix[0, 3] = -12.0 + 12.0 * time
            moved = InstanceSpec(path="/tree", transform=tuple(matrix.ravel()))
            scene.set_instances("/tree", (moved,))
            return scene, view

        sampler(0.0)
        return sampler

    a, b = tree_scene(tree), field_scene(tree)
    settings = {"aovs": ("color", "depth"), "samples": 6}
    found = picture(a, view, sampler=moving(a), lod_error=0, **settings)
    assert_same(found, picture(b, view, sampler=moving(b), **settings))
    assert found["color"].max() > 0.05
