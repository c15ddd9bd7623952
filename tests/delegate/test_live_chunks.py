"""Tests of live splats of nodes, and of what an edit of a tree reads and prepares again."""

from __future__ import annotations

import gc
import os
import weakref
from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf

from tests.delegate.stages import add_camera
from tests.delegate.tree_stages import field_stage, tree_stage
from tests.render.rendering import random_cloud
from usdsplat.core.errors import UsdSplatError
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate import trees
from usdsplat.render.settings import RenderSettings
from usdsplat.schema.chunks import ChunkReader

LEAVES = RenderSettings(lod_error=0.0)
ROOT = RenderSettings(lod_error=1000.0, lod_samples=1)
TREE = "/World/Tree"


@pytest.fixture
def reads(monkeypatch):
    """What is read: the paths of prims of which the table is, and the names of chunks."""
    found, read, table = [], ChunkReader.read, trees.read_tree

    def read_chunk(self, chunk, first, count):
        found.append(os.path.basename(self.chunks[chunk]))
        return read(self, chunk, first, count)

    def read_tree(prim):
        found.append(str(prim.GetPath()))
        return table(prim)

    monkeypatch.setattr(ChunkReader, "read", read_chunk)
    monkeypatch.setattr(trees, "read_tree", read_tree)
    return found


@pytest.fixture
def shown(tmp_path):
    """An engine of a tree, its view, the tree and its stage."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    with Engine(stage, device="cpu") as engine:
        yield engine, engine.view("/Camera", resolution=(80, 60)), tree, stage


def picture_of_field(tree):
    stage = field_stage(tree)
    add_camera(stage)
    with Engine(stage, device="cpu") as engine:
        return engine.picture(engine.view("/Camera", resolution=(80, 60)))["color"].copy()


def held_fields(engine):
    ((_, tree),) = engine.render_scene.drawn_trees()
    return {part[0]: field for part, field in tree.fields.items()}


def test_live_splats_are_drawn_and_nothing_else_is_read_or_prepared(shown, reads):
    """Oracle: the field of the leaves with these splats, bit for bit; the reads, and identity of
    the other nodes' fields, which hold what is prepared. Without them, the first picture."""
    engine, view, tree, _ = shown
    before = engine.picture(view, LEAVES)["color"].copy()
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[2])
    kept = held_fields(engine)
    reads.clear()
    live = replace(random_cloud(5, len(tree.clouds[leaf])), opacities=tree.clouds[leaf].opacities)
    engine.update_chunk(TREE, leaf, live)
    found = engine.picture(view, LEAVES)["color"].copy()
    assert reads == []
    now = held_fields(engine)
    assert {node for node in now if now[node] is not kept[node]} == {leaf}
    original, tree.clouds[leaf] = tree.clouds[leaf], live
    np.testing.assert_array_equal(found, picture_of_field(tree))
    assert (found != before).any()
    tree.clouds[leaf] = original
    engine.update_chunk(TREE, leaf, None)
    np.testing.assert_array_equal(engine.picture(view, LEAVES)["color"], before)


def test_live_proxies_beyond_the_box_of_their_node_are_seen(shown):
    """Oracle: elsewhere nothing is drawn; the view shows only where the proxies have moved."""
    engine, view, tree, _ = shown
    aside = np.eye(4)
    aside[3, 0] = 400.0
    camera = view.camera
    world = np.reshape(camera.world_to_camera, (4, 4))
    moved = np.linalg.inv(aside.T) @ world if np.allclose(world[3, :3], 0) else world @ aside
    far = replace(view, camera=replace(camera, world_to_camera=tuple(moved.ravel())))
    assert engine.picture(far, ROOT)["color"].max() == 0
    cloud = tree.clouds[0]
    shift = np.linalg.inv(moved) @ world
    positions = cloud.positions @ shift[:3, :3].T + shift[:3, 3]
    engine.update_chunk(TREE, 0, replace(cloud, positions=positions.astype(np.float32)))
    assert engine.picture(far, ROOT)["color"].max() > 0.1
    low, high = engine.render_scene.bounds()
    assert (low <= positions.min(axis=0)).all() and (positions.max(axis=0) <= high).all()


def test_live_splats_that_were_replaced_take_no_memory(shown):
    """Oracle: the bytes of the splats of the leaves, after each picture; and weak references."""
    engine, view, tree, _ = shown
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[2])
    engine.picture(view, LEAVES)
    cache = engine.render_scene.node_cache
    of_file = cache.bytes
    before = []
    for seed in range(4):
        live = random_cloud(seed, len(tree.clouds[leaf]))
        engine.update_chunk(TREE, leaf, live)
        engine.picture(view, LEAVES)
        size = sum(each.nbytes for each in (live.positions, live.scales, live.rotations))
        size += live.opacities.nbytes + live.sh.nbytes
        assert cache.bytes == of_file + size  # the splats of the file may be drawn again
        before.append(weakref.ref(live.positions))
        del live
    gc.collect()
    assert [each() is None for each in before] == [True, True, True, False]
    engine.update_chunk(TREE, leaf, None)
    engine.picture(view, LEAVES)
    assert cache.bytes == of_file


def test_a_cloud_that_does_not_fit_is_refused(shown):
    """Oracle: by hand; the picture stays."""
    engine, view, tree, _ = shown
    before = engine.picture(view, LEAVES)["color"].copy()
    count, n = len(tree.clouds[1]), len(tree.table)
    for path, node, cloud, expected in (
        (TREE, 1, random_cloud(1, count + 1), f"expected {count} splats of degree 3"),
        (TREE, 1, random_cloud(1, count, degree=1), "splats of degree 1, expected"),
        (TREE, n, random_cloud(1, count), f"found {n}, expected 0 to {n - 1}"),
        (TREE, -1, None, "found -1, expected 0 to"),
        ("/World", 0, None, "/World: found no splat tree"),
    ):
        with pytest.raises(UsdSplatError, match=expected):
            engine.update_chunk(path, node, cloud)
    np.testing.assert_array_equal(engine.picture(view, LEAVES)["color"], before)


def test_another_table_ends_live_splats_that_do_not_fit_it(shown):
    """Oracle: the picture of a new engine."""
    engine, view, tree, stage = shown
    engine.update_chunk(TREE, 0, random_cloud(2, len(tree.clouds[0])))
    engine.picture(view, ROOT)
    proxies = stage.GetPrimAtPath(TREE).GetAttribute("splat:nodeProxies")
    proxies.Set([int(proxies.Get()[0]) - 1, *list(proxies.Get())[1:]])
    found = engine.picture(view, ROOT)["color"].copy()
    with Engine(stage, device="cpu") as other:
        np.testing.assert_array_equal(found, other.picture(view, ROOT)["color"])


def test_a_grade_reads_neither_table_nor_chunks(shown, reads):
    """Oracle: the reads; and the picture of a new engine."""
    engine, view, _, stage = shown
    engine.picture(view, LEAVES)
    kind = Sdf.ValueTypeNames.Float
    attribute = stage.GetPrimAtPath(TREE).CreateAttribute("splat:grade:exposure", kind)
    attribute.Set(0.3)
    engine.picture(view, LEAVES)
    reads.clear()
    attribute.Set(0.7)
    found = engine.picture(view, LEAVES)["color"].copy()
    assert reads == []
    with Engine(stage, device="cpu") as other:
        np.testing.assert_array_equal(found, other.picture(view, LEAVES)["color"])
