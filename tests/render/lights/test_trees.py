"""Tests of splat trees in the light: as the field of their leaves, at any cut of the view."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.render.lights.light_scenes import add_splats, cloud_of
from tests.render.lights.test_domes import dome, spread_normals
from tests.render.lights.test_shadows import SUN, WHITE, quad, view_from_above
from tests.render.lod.test_nodes import field_scene, tree_scene
from tests.render.lod.trees import Made, concatenated, made
from tests.render.rendering import picture, settings_of
from tests.render.surface_scenes import add
from usdsplat.core.errors import StageError
from usdsplat.core.node_cuts import refined_cut
from usdsplat.kernels.devices import open_device
from usdsplat.render import memory
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights import splat_lighting, trees
from usdsplat.render.lights.memory import lighting_bytes
from usdsplat.render.lights.relighting import field_gains
from usdsplat.render.lights.specs import Shadow
from usdsplat.render.lod.memory import estimate
from usdsplat.render.memory import PictureRequest
from usdsplat.render.patience import Patience
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CropSpec, InstanceSpec
from usdsplat.render.splat_normals import SurfaceValues

HERE = InstanceSpec(path="/tree", transform=tuple(map(float, np.eye(4).ravel())))
AOVS = ("color", "shadow", "depth")
LEAVES = {"lod_error": 0.0, "light_samples": 2, "dome_samples": 4}


def ball_tree(count=600, **options):
    """A closed sphere of splats as a tree."""
    normals = spread_normals(count).astype(np.float32)
    return Made(cloud_of(normals, (0.12, 0.12, 0.12), 0.95, grey=0.6), **{"leaf": 60, **options})


def roofed(scene, height=3.0):
    """A scene with a roof over half of it, a ground, another field and lights."""
    add(scene, "/roof", quad(height, (-3, -3), (0.2, 3), materials=WHITE))
    add(scene, "/ground", quad(-1.5, (-3, -3), (3, 3), materials=WHITE))
    matrix = np.eye(4)
    matrix[:3, 3] = (0.8, 0.3, 1.6)
    add_splats(scene, "/other", cloud_of([[0, 0, 0]], (0.3, 0.3, 0.05), 0.8), matrix)
    scene.set_light("/sun", SUN)
    scene.set_light("/sky", replace(dome(), shadow=Shadow()))
    scene.set_light("/photographed", replace(SUN, direction=(0.0, 0.6, -0.8), is_on=False))
    return scene


def moved(index, x, y=0.0):
    matrix = np.eye(4)
    matrix[:2, 3] = x, y
    return InstanceSpec(path="/tree", index=index, transform=tuple(matrix.ravel()))


@pytest.mark.parametrize("self_shadows", [False, True])
@pytest.mark.parametrize("named", [(), ("/photographed",)])
@pytest.mark.parametrize("mode", ["shadowed", "relit"])
def test_a_tree_is_lit_as_the_field_of_its_leaves(mode, named, self_shadows):
    """Oracle: the field, whose splats have the same places and normals; it differs in the order of
    sums only. The shadow on the ground, which is seen through the tree, is in the picture."""
    tree = ball_tree(strays=5)
    options = {"captured_lights": named}
    settings = {**LEAVES, "lighting": mode, "self_shadows": self_shadows}
    view = view_from_above(half=2.5)
    found, expected, plain = (
        picture(roofed(scene), view, aovs=AOVS, **{**settings, **more})
        for scene, more in (
            (tree_scene(tree, HERE, **options), {}),
            (field_scene(tree, HERE, **options), {}),
            (field_scene(tree, HERE, **options), {"lighting": "captured"}),
        )
    )
    for name in ("color", "shadow"):
        np.testing.assert_allclose(found[name], expected[name], atol=2e-4, err_msg=name)
    assert np.abs(plain["color"] - expected["color"]).max() > 0.05


@pytest.mark.parametrize("mode", ["shadowed", "relit"])
def test_instances_of_a_cropped_tree_are_lit_as_those_of_a_field(mode):
    """Oracle: the field; instances shadow each other, and the volume cuts casters, too."""
    tree = made(3, n=300, degree=0, leaf=40)
    crop = CropSpec(
        shape="cube", keeps=True,
        world_to_shape=(0.3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1),
    )  # fmt: skip
    view, instances = view_from_above(half=2.5), (moved(0, -0.4), moved(1, 0.5, 0.2))
    found, expected = (
        picture(
            roofed(make(tree, *instances, crops=(crop,))), view, aovs=AOVS, lighting=mode, **LEAVES
        )
        for make in (tree_scene, field_scene)
    )
    for name in ("color", "shadow"):
        np.testing.assert_allclose(found[name], expected[name], atol=2e-4, err_msg=name)


def test_what_is_outside_of_the_view_casts_its_shadow():
    """Oracle: the field; no splat of the caster is in the picture, and no node of it is drawn."""
    tree = made(2, n=300, degree=0, leaf=40)
    light = replace(SUN, direction=(0.6, 0.0, -0.8))
    view = view_from_above((40, 40), half=0.7)
    found = []
    for make in (tree_scene, field_scene):
        scene = make(tree, moved(0, -12.0))
        add(scene, "/ground", quad(-16.0, (-3, -3), (3, 3), materials=WHITE))
        scene.set_light("/sun", light)
        found.append(picture(scene, view, aovs=AOVS, lighting="shadowed", **LEAVES))
    np.testing.assert_allclose(found[0]["color"], found[1]["color"], atol=1e-4)
    assert found[0]["shadow"].min() < 0.3


def test_the_shadow_of_a_tree_does_not_depend_on_the_view():
    """Oracle: bit for bit the same shadow on a ground, whatever the picture refines."""
    tree = made(2, n=600, degree=0, leaf=40)
    found = []
    for error in (0.0, 2.0, 1000.0):
        scene = tree_scene(tree, HERE)
        add(scene, "/ground", quad(-2.0, (-3, -3), (3, 3), materials=WHITE))
        scene.set_light("/sun", SUN)
        view = replace(view_from_above(), catchers=(("/ground", True),))
        settings = {**LEAVES, "lod_error": error, "lighting": "shadowed"}
        drawn = picture(scene, view, aovs=("shadow", "elementId"), **settings)
        found.append(drawn["shadow"])
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])
    assert found[0].min() < 0.5


@pytest.mark.parametrize("most", [100, 250])
def test_a_coarser_cut_is_lit_nearly_as_the_leaves(monkeypatch, most):
    """Oracle: the field. Half of the proxies of a node stand for it, so normals are looked up
    between splats; no splat is more than 0.1 off, and the mean is 0.02."""
    tree = ball_tree(1200)
    expected = picture(
        roofed(field_scene(tree, HERE), 0.5), view_from_above(), aovs=AOVS, lighting="relit",
        **LEAVES,
    )  # fmt: skip
    monkeypatch.setattr(trees, "TREE_SPLATS", most)
    found = picture(
        roofed(tree_scene(tree, HERE), 0.5), view_from_above(), aovs=AOVS, lighting="relit",
        **LEAVES,
    )  # fmt: skip
    error = np.abs(found["color"] - expected["color"])[..., :3]
    assert error.max() < 0.1 and error.mean() < 0.02


def test_rules_of_the_picture_choose_the_mode_of_a_tree():
    """Oracle: the picture in that mode, bit for bit."""
    tree, view = ball_tree(), view_from_above()
    ruled = replace(view, light_rules=(("relit", (("/tree", True),)),))
    found = picture(tree_scene_with_sun(tree), ruled, aovs=("color",), **LEAVES)
    relit = {**LEAVES, "lighting": "relit"}
    expected = picture(tree_scene_with_sun(tree), view, aovs=("color",), **relit)
    np.testing.assert_array_equal(found["color"], expected["color"])


def tree_scene_with_sun(tree):
    scene = tree_scene(tree, HERE)
    scene.set_light("/sun", SUN)
    return scene


def test_light_of_nodes_is_kept_while_the_camera_moves():
    """Oracle: the sums of a node are the same objects, though its place in the layout changes; the
    picture is that of a new renderer."""
    tree = ball_tree()
    scene, renderer = roofed(tree_scene(tree, HERE)), Renderer(open_device())
    settings = settings_of(**{**LEAVES, "lighting": "relit"})

    def drawn(by, window):
        view = view_from_above((60, 60), half=1.2, window=window)
        bands = by.render(scene, view, settings, ("color",))
        return np.concatenate([band.arrays["color"] for band in bands])

    drawn(renderer, (0, 0, 60, 60))
    store = renderer._idle[0].lights
    before = {key: each[1] for key, each in store.sums.items()}
    part = drawn(renderer, (45, 0, 60, 60))
    after = {key: each[1] for key, each in store.sums.items()}
    assert 0 < len(after) < len(before)
    assert all(before[key] is each for key, each in after.items())
    np.testing.assert_array_equal(part, drawn(Renderer(open_device()), (45, 0, 60, 60)))


def test_all_nodes_share_the_means_of_their_cut(monkeypatch):
    """Oracle: the number of means that a picture computes: one of the present light, and one of
    that of the photographs; none in the next picture, which has the same light."""
    tree, computed = ball_tree(), []
    mean = splat_lighting.part_of_mean
    monkeypatch.setattr(
        splat_lighting, "part_of_mean", lambda *args: computed.append(1) or mean(*args)
    )
    scene, renderer = roofed(tree_scene(tree, HERE)), Renderer(open_device())
    scene.remove("/other")
    settings = settings_of(**{**LEAVES, "lighting": "relit"})
    list(renderer.render(scene, view_from_above(), settings, ("color",)))
    store = renderer._idle[0].lights
    assert len(store.gains) > 2 and len(computed) == 2
    list(renderer.render(scene, view_from_above(), settings, ("color",)))
    assert len(computed) == 2


def test_edits_of_a_tree_are_drawn():
    """Oracle: a new renderer's picture after each edit, bit for bit."""
    tree = ball_tree()
    scene, renderer = roofed(tree_scene(tree, HERE)), Renderer(open_device())
    settings, view = settings_of(**LEAVES), view_from_above()
    node = int(np.flatnonzero(tree.table.child_count == 0)[0])
    dark = replace(tree.clouds[node], sh=tree.clouds[node].sh - 1)
    edits = [
        {"lighting": "shadowed"},
        {"lighting": "relit"},
        {"lighting": "relit", "captured_lights": ("/photographed",)},
        {"lighting": "relit", "live": {node: (object(), dark)}},
    ]
    pictures = []
    for options in edits:
        scene.set_tree("/tree", tree.spec(**options))
        found, fresh = (
            np.concatenate([b.arrays["color"] for b in by.render(scene, view, settings, AOVS[:1])])
            for by in (renderer, Renderer(open_device()))
        )
        np.testing.assert_array_equal(found, fresh)
        pictures.append(found.copy())
    for a, b in pairwise(pictures):
        assert not np.array_equal(a, b)


def test_a_tree_without_light_is_drawn_as_before_and_its_cut_is_not_read():
    """Oracle: a picture without lights that need shadows; the reads of the tree."""
    tree = ball_tree()
    scene, plain = tree_scene(tree, HERE), tree_scene(tree, HERE)
    scene.set_light("/dome", dome())
    found = picture(scene, view_from_above(), aovs=("color",), lod_error=1000.0)
    assert len(tree.reads) == 1
    expected = picture(plain, view_from_above(), aovs=("color",), lod_error=1000.0)
    np.testing.assert_array_equal(found["color"], expected["color"])


@pytest.mark.parametrize("first", [1, 3, 9])
def test_coarser_nodes_cast_shadows_for_those_that_cannot_be_read(first):
    """Oracle: a tree of which these nodes are the leaves."""
    tree = ball_tree()

    def load(chunk, row, count):
        if chunk >= first:
            raise StageError("chunk", "nothing", "a file")
        return tree.load(chunk, row, count)

    shadows = []
    for make in (lambda: tree_scene(tree, HERE, load=load), lambda: _pruned(tree, first)):
        scene = make()
        add(scene, "/ground", quad(-2.0, (-3, -3), (3, 3), materials=WHITE))
        scene.set_light("/sun", SUN)
        view = replace(view_from_above(), catchers=(("/ground", True),))
        shadows.append(picture(scene, view, aovs=("shadow",), **LEAVES)["shadow"])
    np.testing.assert_allclose(shadows[0], shadows[1], atol=1e-4)
    assert shadows[0].min() < 0.5


def test_chunks_of_casters_that_cannot_be_read_are_problems_of_the_tree():
    """Oracle: the chunks that fail, in a picture that draws the root alone; also after an edit that
    keeps the cut."""
    tree = ball_tree()
    last = int(tree.table.chunk.max())

    def load(chunk, row, count):
        if chunk == last:
            raise StageError("chunk", "nothing", "a file")
        return tree.load(chunk, row, count)

    scene = tree_scene(tree, HERE, load=load)
    scene.set_light("/sun", SUN)
    renderer, view = Renderer(open_device()), view_from_above()
    settings = settings_of(**{**LEAVES, "lod_error": 1000.0, "lighting": "shadowed"})
    for options in ({}, {"captured_lights": ("/sun",)}):
        scene.set_tree("/tree", tree.spec(load=load, **options))
        list(renderer.render(scene, view, settings, ("color",)))
        assert scene.tree("/tree").problems.keys() == {last}


def _pruned(tree, first):
    """A scene of the nodes above nodes that cannot be read, as a field: a child that cannot be read
    hides its sibling, too."""
    table = tree.table
    refined = np.zeros(len(table), np.bool_)
    for node in np.flatnonzero(table.child_count):
        refined[node] = table.first_child[node] + table.child_count[node] <= first
    nodes = refined_cut(table, refined).nodes
    scene = RenderScene()
    cloud = concatenated([tree.clouds[node] for node in nodes])
    return add_splats(scene, "/tree", cloud)


def test_the_cuts_of_all_trees_share_a_number_of_splats(monkeypatch):
    """Oracle: 2^18 for one tree, and 2^20 for all instances."""
    tree = made(1, n=100, degree=0)
    for count, expected in ((1, 1 << 18), (4, 1 << 18), (8, 1 << 17)):
        scene = tree_scene(tree, *(moved(index, 2.0 * index) for index in range(count)))
        assert trees.cut_size(scene) == expected
    monkeypatch.setattr(trees, "ALL_SPLATS", 8 * 50)
    found = trees.casters_of(scene, settings_of(), trees.TreeStore())
    assert len(found.trees["/tree"].splats.spec.cloud) <= 50
    assert found.layout.splats == 8 * len(found.trees["/tree"].splats.spec.cloud)


def test_another_splat_budget_does_not_read_the_cut_again():
    """Oracle: the cut and its normals are the same objects, and nothing more is read."""
    tree = ball_tree()
    scene, store = tree_scene_with_sun(tree), trees.TreeStore()
    first = trees.casters_of(scene, settings_of(), store)
    reads = len(tree.reads)
    second = trees.casters_of(scene, settings_of(splat_budget=10), store)
    assert second.trees["/tree"] is first.trees["/tree"] and len(tree.reads) == reads


def test_a_picture_that_does_not_wait_reads_no_cut(monkeypatch):
    """Oracle: the number of cuts that are read, before there is any light, after a picture that
    waits, and after an edit of the tree; the last two pictures say whether they lack their light.
    The cut that is kept survives."""
    tree, read = ball_tree(), []
    scene, renderer = tree_scene_with_sun(tree), Renderer(open_device())
    cut = trees._read
    monkeypatch.setattr(trees, "_read", lambda *args: read.append(1) or cut(*args))

    def drawn(light):
        settings = settings_of(**LEAVES, lighting="shadowed")
        patience = Patience(light=light)
        bands = renderer.render(scene, view_from_above(), settings, ("color",), patience=patience)
        return np.concatenate([band.arrays["color"].copy() for band in bands])

    drawn(False)
    assert read == []
    waited = drawn(True)
    assert read == [1]
    np.testing.assert_array_equal(drawn(False), waited)
    assert not renderer.stats.lacks_light
    node = int(np.flatnonzero(tree.table.child_count == 0)[0])
    dark = replace(tree.clouds[node], sh=tree.clouds[node].sh - 1)
    before = renderer._idle[0].lights.trees.lit["/tree"]
    scene.set_tree("/tree", tree.spec(live={node: (object(), dark)}))
    drawn(False)
    assert read == [1] and renderer.stats.lacks_light
    assert renderer._idle[0].lights.trees.lit["/tree"] is before
    drawn(True)
    assert read == [1, 1] and not renderer.stats.lacks_light


def test_values_are_looked_up_at_the_nearest_splats():
    """Oracle: a splat's own values at its centre, and the inverse squared distances between."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    own = SurfaceValues(normals, rng.uniform(size=(50, 2)).astype(np.float32))
    same = trees.looked_up(own, points, points)
    np.testing.assert_allclose(same.normals, own.normals, atol=1e-6)
    np.testing.assert_allclose(same.facts, own.facts, atol=1e-6)
    at = rng.normal(size=(20, 3)).astype(np.float32)
    found = trees.looked_up(own, points, at)
    distance = np.linalg.norm(at[:, None] - points[None], axis=2)
    for i, row in enumerate(np.argsort(distance, axis=1)[:, :4]):
        weights = 1 / distance[i, row] ** 2
        weights /= weights.sum()
        mean = weights @ normals[row]
        np.testing.assert_allclose(found.normals[i], mean / np.linalg.norm(mean), atol=1e-5)
        np.testing.assert_allclose(found.facts[i], weights @ own.facts[row], atol=1e-5)
    few = trees.looked_up(SurfaceValues(normals[:2], own.facts[:2]), points[:2], at)
    assert np.isfinite(few.normals).all() and np.isfinite(few.facts).all()


def test_the_memory_of_lit_trees_is_estimated_without_reading_them():
    """Oracle: the sums and normals that a renderer keeps after a picture."""
    tree = ball_tree()
    scene, view = roofed(tree_scene(tree, HERE)), view_from_above()
    request = PictureRequest(aovs=("color",))
    sizes = {}
    for mode in ("captured", "relit"):
        settings = settings_of(**{**LEAVES, "lighting": mode})
        sizes[mode] = estimate(scene, view, settings, request, band_pixels=1 << 20, threads=1)
    assert tree.reads == []
    renderer = Renderer(open_device())
    list(renderer.render(scene, view, settings, ("color",)))
    store = renderer._idle[0].lights
    kept = [each[1] for each in (*store.sums.values(), *store.estimates.values())]
    arrays = sum(int(np.prod(each.shape)) * 4 for each in kept)
    [lit] = store.trees.lit.values()
    arrays += sum(each.normals.nbytes + each.facts.nbytes for _, each in lit.nodes.values())
    assert sizes["relit"].splats - sizes["captured"].splats >= arrays
    assert lighting_bytes(RenderScene(), view, settings, {"color"}) == (0, 0)


def test_the_memory_of_aovs_of_light_with_trees_is_estimated():
    """Oracle: the buffers of sums and their repetitions, which this picture has for its tree."""
    scene, view = roofed(tree_scene(ball_tree(), HERE)), view_from_above()
    settings = settings_of(
        lod_error=8.0, light_samples=2, dome_samples=4, lighting="relit", color_mode="scene"
    )
    aovs = ("color", "light_default", "light_captured", "shadow", "irradiance")

    def of_trees(names):
        request = PictureRequest(aovs=names)
        whole, others = (
            each(scene, view, settings, request, band_pixels=1 << 20, threads=1).band
            for each in (estimate, memory.estimate)
        )
        return whole - others

    renderer = Renderer(open_device())
    list(renderer.render(scene, view, settings, aovs))
    sizes = renderer._idle[0].allocated()
    held = ("sums.lights", "sums.shadow", "sums.irradiance", "layers.lights")
    assert of_trees(aovs) - of_trees(aovs[:1]) >= sum(sizes[name] for name in held)


def test_colours_of_several_times_share_the_cuts_of_trees(monkeypatch):
    """Oracle: the number of cuts that are read for two lights, and the gains of new buffers."""
    tree, read, device = ball_tree(), [], open_device()
    cut = trees._read
    monkeypatch.setattr(trees, "_read", lambda *args: read.append(1) or cut(*args))
    scene, settings = roofed(tree_scene(tree, HERE)), settings_of(lighting="relit", dome_samples=4)
    buffers = FrameBuffers(device.resident)
    first = field_gains(device, scene, settings, buffers)["/other"]
    scene.set_light("/sun", replace(SUN, direction=(0.5, 0.0, -0.8)))
    second = field_gains(device, scene, settings, buffers)["/other"]
    assert read == [1]
    fresh = field_gains(device, scene, settings, FrameBuffers(device.resident))["/other"]
    np.testing.assert_array_equal(second, fresh)
    assert not np.array_equal(first, second)
