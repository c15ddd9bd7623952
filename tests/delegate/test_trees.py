"""Tests of splat trees on a stage: pictures, what acts on the prim, edits, missing chunks."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, Vt

from tests.delegate.stages import add_camera
from tests.delegate.tree_stages import field_stage, tree_stage, write_chunk
from tests.render.rendering import random_cloud
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate import trees
from usdsplat.render.lod import nodes
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CropSpec
from usdsplat.schema.chunks import ChunkReader

LEAVES = RenderSettings(lod_error=0.0)
AOVS = ("color", "depth", "primId", "instanceId", "elementId", "cryptoObject")


@pytest.fixture
def reads(monkeypatch):
    """The rows that are read from chunks: (file name, first, count)."""
    found, read = [], ChunkReader.read

    def recorded(self, chunk, first, count):
        found.append((os.path.basename(self.chunks[chunk]), first, count))
        return read(self, chunk, first, count)

    monkeypatch.setattr(ChunkReader, "read", recorded)
    monkeypatch.setattr(trees, "POLL", 0.0)
    return found


def pictured(stage, settings=LEAVES, aovs=AOVS):
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        return {k: v.copy() for k, v in engine.picture(view, settings, aovs).items()}


def assert_same(found, expected):
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


def moved(stage):
    """A camera, a transform and a grade; for both forms alike."""
    add_camera(stage)
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation((1, 2, 0), 40))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTransformOp().Set(turn)
    tree = stage.GetPrimAtPath("/World/Tree")
    tree.CreateAttribute("splat:grade:exposure", Sdf.ValueTypeNames.Float).Set(0.5)
    return stage


def test_a_tree_is_drawn_as_the_field_of_its_leaves(tmp_path):
    """Oracle: a field with the same splats, transform and grade, bit for bit."""
    stage, tree = tree_stage(tmp_path)
    assert_same(pictured(moved(stage)), pictured(moved(field_stage(tree))))


def test_point_instances_visibility_and_purpose_act_on_a_tree(tmp_path):
    """Oracle: a field with the same splats under the same instancer; and nothing if hidden."""

    def instanced(stage):
        add_camera(stage)
        instancer = UsdGeom.PointInstancer.Define(stage, "/Many")
        instancer.CreatePositionsAttr([(0, 0, 0), (1.5, 0.2, -2)])
        instancer.CreateProtoIndicesAttr([0, 0])
        instancer.CreatePrototypesRel().AddTarget("/World/Tree")
        return stage

    stage, tree = tree_stage(tmp_path)
    found = pictured(instanced(stage))
    assert_same(found, pictured(instanced(field_stage(tree))))
    assert found["instanceId"].max() >= 1
    UsdGeom.Imageable(stage.GetPrimAtPath("/World")).MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/Many")).MakeInvisible()
    assert pictured(stage, aovs=("color",))["color"].max() == 0


def test_an_edited_chunk_is_read_again_and_nothing_else(tmp_path, reads):
    """Oracle: the reads; and a new engine's picture."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[2])
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        engine.picture(view, LEAVES)
        assert len(reads) == (tree.table.child_count == 0).sum()
        reads.clear()
        engine.picture(replace(view, matte=(("/none", True),)), LEAVES)
        assert reads == []
        layer = Sdf.Layer.FindOrOpen(str(tmp_path / "tree_chunks" / f"{leaf:04}.usdc"))
        attribute = layer.GetAttributeAtPath("/splats.opacities")
        attribute.default = type(attribute.default)(len(attribute.default), 0.0)
        found = engine.picture(view, LEAVES)["color"].copy()
        assert reads == [(f"{leaf:04}.usdc", 0, int(tree.table.proxies[leaf]))]
    np.testing.assert_array_equal(found, pictured(stage)["color"])


def test_a_chunk_that_changed_on_disk_is_read_again(tmp_path, reads):
    """Oracle: the reads; and the picture of the field with the new splats."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[1])
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        before = engine.picture(view, LEAVES)["color"].copy()
        reads.clear()
        tree.clouds[leaf] = replace(tree.clouds[leaf], opacities=tree.clouds[leaf].opacities * 0)
        path = tmp_path / "tree_chunks" / f"{leaf:04}.usdc"
        path.unlink()
        write_chunk(path, tree.clouds[leaf])
        after = engine.picture(view, LEAVES)["color"].copy()
        assert [name for name, _, _ in reads] == [path.name]
    assert (before != after).any()
    expected = field_stage(tree)
    add_camera(expected)
    np.testing.assert_array_equal(after, pictured(expected)["color"])


def test_an_edited_table_reads_no_chunk_again(tmp_path, reads):
    """Oracle: the reads. With larger errors, leaves are needed where the root was drawn."""
    stage, _ = tree_stage(tmp_path)
    add_camera(stage)
    coarse = RenderSettings(lod_error=1.0, lod_samples=1)
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        errors = stage.GetPrimAtPath("/World/Tree").GetAttribute("splat:nodeErrors")
        fine = list(errors.Get())
        errors.Set([1e-4 * each for each in fine])
        engine.picture(view, coarse)
        assert [name for name, _, _ in reads] == ["0000.usdc"]
        errors.Set([1e4 * each for each in fine])
        engine.picture(view, coarse)
        assert "0000.usdc" not in [name for name, _, _ in reads[1:]] and len(reads) > 4
        count = len(reads)
        errors.Set([1e-4 * each for each in fine])
        engine.picture(view, coarse)
        assert len(reads) == count


def test_a_missing_chunk_is_one_finding_and_its_parent_stays(tmp_path):
    """Oracle: by hand; the rest of the picture is drawn."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[0])
    (tmp_path / "tree_chunks" / f"{leaf:04}.usdc").unlink()
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        found = engine.picture(view, LEAVES, ("color", "elementId"))
        (finding,) = [each for each in engine.findings if each.code == "missing-chunk"]
        assert f"without {leaf:04}.usdc in ./tree_chunks" in finding.message
        assert found["elementId"].max() >= len(tree.leaves())  # proxies of the parent


@pytest.mark.parametrize("content", [None, b"no crate"])
def test_a_chunk_that_appears_later_is_drawn(tmp_path, reads, content):
    """Oracle: the first picture, of the whole tree; only the chunk and its parent are read again,
    and the finding goes. Before, the file is missing or broken."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    whole = pictured(stage, aovs=("color",))["color"]
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[0])
    path = tmp_path / "tree_chunks" / f"{leaf:04}.usdc"
    kept = path.read_bytes()
    path.unlink()
    if content:
        path.write_bytes(content)
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        found = engine.picture(view, LEAVES, ("color",))["color"]
        assert (found != whole).any() and engine.findings
        reads.clear()
        path.unlink(missing_ok=True)
        path.write_bytes(kept)
        np.testing.assert_array_equal(engine.picture(view, LEAVES, ("color",))["color"], whole)
        assert path.name in {name for name, _, _ in reads} and len(reads) <= 2
        assert not [each for each in engine.findings if each.severity != "note"]


def test_a_moved_folder_is_one_finding_that_names_it(tmp_path):
    """Oracle: by hand; nothing can be drawn, as the root is missing too."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    (tmp_path / "tree_chunks").rename(tmp_path / "elsewhere")
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        assert engine.picture(view, LEAVES)["color"].max() == 0
        (finding,) = [each for each in engine.findings if each.code == "missing-chunk"]
    assert f"none of {len(tree.table)} chunks" in finding.message
    assert "in ./tree_chunks" in finding.message


def test_a_broken_chunk_says_why(tmp_path):
    """Oracle: by hand."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[0])
    (tmp_path / "tree_chunks" / f"{leaf:04}.usdc").write_bytes(b"no crate")
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        assert engine.picture(view, LEAVES)["color"].max() > 0
        (finding,) = [each for each in engine.findings if each.code == "broken-chunk"]
    assert f"{leaf:04}.usdc: " in finding.message


def test_a_chunk_of_a_tree_that_was_built_anew_is_not_drawn(tmp_path, reads):
    """Oracle: the picture without the chunk. Its rows have changed, but the table of the stage has
    not been read again."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[0])
    path = tmp_path / "tree_chunks" / f"{leaf:04}.usdc"
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        engine.picture(view, LEAVES)
        path.unlink()
        write_chunk(path, random_cloud(1, len(tree.clouds[leaf]) + 1))
        found = engine.picture(view, LEAVES)["color"].copy()
        (finding,) = [each for each in engine.findings if each.code == "broken-chunk"]
    assert "expected 50 as before; reload the stage" in finding.message
    path.write_bytes(b"no crate")
    np.testing.assert_array_equal(found, pictured(stage)["color"])


def test_a_chunk_of_another_degree_is_a_finding(tmp_path):
    """Oracle: by hand; the rest is drawn."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[0])
    count = len(tree.clouds[leaf])
    path = tmp_path / "tree_chunks" / f"{leaf:04}.usdc"
    path.unlink()
    write_chunk(path, random_cloud(1, count, degree=1))
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        assert engine.picture(view, LEAVES)["color"].max() > 0
        (finding,) = [each for each in engine.findings if each.code == "broken-chunk"]
    assert "harmonics of degree 1, expected 3, as in the tree" in finding.message


def test_a_table_that_lies_is_not_drawn(tmp_path):
    """Oracle: the finding that `validate` has."""
    stage, _ = tree_stage(tmp_path)
    add_camera(stage)
    prim = stage.GetPrimAtPath("/World/Tree")
    prim.GetAttribute("splat:nodeFirstChild").Set([5])
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        assert engine.picture(view, LEAVES)["color"].max() == 0
        assert [each.code for each in engine.findings if each.severity == "error"] == [
            "broken-tree"
        ]


def test_a_tree_that_becomes_a_field_and_back_is_drawn_as_each(tmp_path):
    """Oracle: new engines."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    prim = stage.GetPrimAtPath("/World/Tree")
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        as_tree = engine.picture(view, LEAVES)["color"].copy()
        schema.author(stage, "/World/Tree", tree.strays if len(tree.strays) else tree.clouds[0])
        np.testing.assert_array_equal(engine.picture(view)["color"], pictured(stage)["color"])
        prim.SetTypeName("ParticleFieldSplatTree")
        np.testing.assert_array_equal(engine.picture(view, LEAVES)["color"], as_tree)


def test_a_field_beside_a_tree_is_drawn_as_it_is_now(tmp_path):
    """Oracle: a new engine, after edits of the field, at another time, and with splats that move
    within the shutter."""
    stage, _ = tree_stage(tmp_path)
    add_camera(stage)
    clouds = [random_cloud(9, 40)]
    clouds.append(replace(clouds[0], positions=clouds[0].positions + np.float32(0.4)))
    prim = schema.author(stage, "/World/Ball", clouds[0])
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))

        def assert_drawn(settings=LEAVES):
            found = engine.picture(view, settings)["color"].copy()
            with Engine(stage, device="cpu") as other:
                other.set_time(engine.time)
                np.testing.assert_array_equal(found, other.picture(view, settings)["color"])
            return found

        before = assert_drawn()
        schema.author(stage, "/World/Ball", clouds[1])
        assert np.abs(assert_drawn() - before).max() > 0.1
        positions = prim.GetAttribute("positions")
        for time, cloud in enumerate(clouds):
            positions.Set(Vt.Vec3fArray.FromNumpy(cloud.positions), time)
        for time in (0.0, 1.0, 0.5):
            engine.set_time(time)
            assert_drawn()
        camera = UsdGeom.Camera(stage.GetPrimAtPath("/Camera"))
        camera.CreateShutterOpenAttr(-0.5)
        camera.CreateShutterCloseAttr(0.5)
        view = engine.view("/Camera", resolution=(80, 60))
        assert_drawn(replace(LEAVES, samples=4))


def test_a_tree_is_laid_out_once_for_a_crop_or_a_grade(tmp_path, monkeypatch):
    """Oracle: the calls: equal cuts of a moving camera need one layout."""
    stage, _ = tree_stage(tmp_path)
    moved(stage)
    calls, laid_out = [], nodes.laid_out
    monkeypatch.setattr(nodes, "laid_out", lambda *a, **k: calls.append(0) or laid_out(*a, **k))
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(80, 60))
        engine.picture(view, LEAVES)
        crop = CropSpec(shape="sphere", world_to_shape=tuple(np.eye(4).ravel()), keeps=True)
        engine.render_scene.set_crops("/World/Tree", (crop,))
        engine.picture(view, LEAVES)
        stage.GetPrimAtPath("/World/Tree").GetAttribute("splat:grade:exposure").Set(0.2)
        engine.picture(view, LEAVES)
        calls.clear()
        camera = UsdGeom.Camera(stage.GetPrimAtPath("/Camera"))
        for length in (30.0, 30.5, 31.0):
            camera.GetFocalLengthAttr().Set(length)
            engine.picture(engine.view("/Camera", resolution=(80, 60)), LEAVES)
        assert not calls


def test_a_closed_engine_watches_no_layers(tmp_path):
    """Oracle: an edit after closing reaches nothing of the engine."""
    stage, _ = tree_stage(tmp_path)
    add_camera(stage)
    engine = Engine(stage, device="cpu")
    view = engine.view("/Camera", resolution=(80, 60))
    engine.picture(view, LEAVES)
    scene = engine.render_scene
    assert scene.node_cache.bytes > 0
    chunks = engine._scene._chunks
    engine.close()
    assert scene.node_cache.bytes == 0
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "tree_chunks" / "0000.usdc"))
    layer.comment = "edited"
    assert chunks._changed == set()


def test_the_cache_is_emptied_when_the_last_tree_goes(tmp_path):
    """Oracle: its bytes."""
    stage, _ = tree_stage(tmp_path)
    add_camera(stage)
    with Engine(stage, device="cpu") as engine:
        engine.picture(engine.view("/Camera", resolution=(80, 60)), LEAVES)
        assert engine.render_scene.node_cache.bytes > 0
        stage.RemovePrim("/World/Tree")
        assert engine.render_scene.node_cache.bytes == 0
