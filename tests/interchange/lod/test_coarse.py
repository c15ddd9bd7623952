"""Tests of the coarse fields beside a tree, for renderers that do not draw trees."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.interchange.lod.worlds import ground
from usdsplat import formats, schema
from usdsplat.core.errors import StageError
from usdsplat.core.lod_heuristics import LodView
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import ImportOptions, convert
from usdsplat.interchange.lod import LodOptions, build_tree
from usdsplat.products import summary
from usdsplat.schema.lod_roots import read_lod_root
from usdsplat.sim.stage.collections import splats

NOW = Usd.TimeCode.Default()


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A tree of 30,000 splats in one leaf, and its report."""
    folder = tmp_path_factory.mktemp("coarse")
    formats.write(ground(30_000, 1), folder / "scan.ply")
    target = folder / "t.usda"
    return target, build_tree(folder / "scan.ply", target, options=LodOptions(axes="rdf"))


def root_of(path):
    """The stage of a tree, and its LOD root."""
    stage = Usd.Stage.Open(str(path))
    return stage, stage.GetPrimAtPath("/t/coarse/levels")


def test_fields_are_the_top_levels_of_the_tree(built):
    """Oracle: closed form: a quarter of the splats, and a quarter of those; and the splats of
    these nodes in the chunk of the top."""
    path, report = built
    stage, root = root_of(path)
    assert report.coarse == (7500, 1875)
    top = schema.read_chunk(str(path.parent / "t_chunks" / "0000.usdc"), 0, 1875 + 7500)
    items = [schema.fetch(prim) for prim in root.GetChildren()]
    assert stage and [len(each) for each in items] == [7500, 1875]
    for item, rows in zip(items, (slice(1875, None), slice(1875)), strict=True):
        np.testing.assert_array_equal(item.positions, top.positions[rows])
        np.testing.assert_array_equal(item.sh, top.sh[rows])
    assert {schema.rasterize_mode(prim) for prim in root.GetChildren()} == {"antialiased"}


def test_other_renderers_see_the_finest_at_the_place_of_the_tree(built):
    """Oracle: USD's visibility, transforms and bounds; the stock type."""
    path, _ = built
    stage, root = root_of(path)
    cache = UsdGeom.XformCache()
    own = cache.GetLocalToWorldTransform(stage.GetPrimAtPath("/t/splats"))
    shown = []
    for prim in root.GetChildren():
        assert prim.GetTypeName() == "ParticleField3DGaussianSplat"
        assert cache.GetLocalToWorldTransform(prim) == own
        if UsdGeom.Imageable(prim).ComputeVisibility() != "invisible":
            shown.append(prim.GetName())
    assert shown == ["lod0"]
    assert read_lod_root(root, NOW).default == 0
    (reference,) = stage.GetRootLayer().GetPrimAtPath("/t/coarse").referenceList.prependedItems
    assert reference.assetPath == "./t_chunks/coarse.usdc"


def test_the_next_field_follows_where_its_error_is_a_pixel(built):
    """Oracle: closed form: the distance at which a pixel of a picture of 1920 x 1080 has the size
    of the error that the tree states for the node."""
    path, _ = built
    stage, root = root_of(path)
    errors = np.asarray(stage.GetPrimAtPath("/t/splats").GetAttribute("splat:nodeErrors").Get())
    read = read_lod_root(root, NOW)
    assert read.heuristic is not None
    low, high = np.array(read.heuristic.low), np.array(read.heuristic.high)
    width = 0.7
    distance = float(errors[0]) * 1920 / width
    for factor, name in ((0.98, "lod0"), (1.02, "lod1")):
        eye = 0.5 * (low + high) + (0, 0, factor * distance)
        view = LodView(
            eye=tuple(map(float, eye)), window=(width, width * 1080 / 1920), to_clip=np.eye(4)
        )
        assert read.shown(view) == (f"/t/coarse/levels/{name}",)
    assert 0 < distance < math.inf


def test_we_draw_export_and_describe_the_tree_in_their_place(built, tmp_path):
    """Oracle: the 30,000 splats of the capture."""
    path, _ = built
    stage, _ = root_of(path)
    with Engine(stage) as engine:
        assert engine.fields() == ["/t/splats"]
        assert engine.render_scene.draw_list().total == 30_000
    assert convert(path, tmp_path / "back.ply").splats == 30_000
    told = summary.of_stage(stage, None)
    assert (told["fields"], told["splats"], told["splats_drawn"]) == ([], 30_000, 30_000)
    assert told["trees"][0]["lod_root"] == "/t/coarse/levels"


def test_a_tree_of_one_leaf_has_its_splats_as_a_field(tmp_path):
    """Oracle: the capture, which is small enough for any renderer."""
    formats.write(ground(900), tmp_path / "scan.ply")
    report = build_tree(tmp_path / "scan.ply", tmp_path / "t.usda")
    stage, root = root_of(tmp_path / "t.usda")
    (item,) = root.GetChildren()
    assert report.coarse == (900,) and stage
    assert schema.rasterize_mode(item) == "classic"
    order, expected = (
        np.lexsort(each.positions.T)
        for each in (schema.fetch(item), formats.read(tmp_path / "scan.ply").cloud)
    )
    np.testing.assert_array_equal(
        schema.fetch(item).positions[order],
        formats.read(tmp_path / "scan.ply").cloud.positions[expected],
    )


def test_a_tree_of_many_small_nodes_has_cuts_of_them(tmp_path):
    """Oracle: the limits of the fields; every one is at most half as large as the one before."""
    formats.write(ground(60_000), tmp_path / "scan.ply")
    options = LodOptions(leaf_splats=512)
    report = build_tree(tmp_path / "scan.ply", tmp_path / "t.usda", options=options)
    assert len(report.coarse) == 2
    for count, most in zip(report.coarse, (20_480, 5_120), strict=True):
        assert most / 4 < count <= most
    _, root = root_of(tmp_path / "t.usda")
    assert [len(schema.fetch(each)) for each in root.GetChildren()] == list(report.coarse)


@pytest.mark.parametrize("flatten", [False, True])
def test_conversions_of_fields_leave_them_alone(built, tmp_path, flatten):
    """Oracle: the forms of all fields: only the field that is not for other renderers changes."""
    path, _ = built
    with pytest.raises(StageError, match="found splat trees and no splat field"):
        convert(path, tmp_path / "a.usdc", options=ImportOptions(form="packed"), flatten=flatten)
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    stage.DefinePrim("/City").GetReferences().AddReference(str(path))
    schema.author(stage, "/Ball", ground(50))
    stage.Save()
    options = ImportOptions(form="packed")
    convert(tmp_path / "shot.usda", tmp_path / "b.usdc", options=options, flatten=flatten)
    made = Usd.Stage.Open(str(tmp_path / "b.usdc"))
    assert schema.form_of(made.GetPrimAtPath("/Ball")) == "packed"
    items = made.GetPrimAtPath("/City/coarse/levels").GetChildren()
    assert [schema.form_of(each) for each in items] == ["float", "float"]


def test_they_are_in_no_simulation(built):
    """Oracle: the collection of a simulation of the whole stage, which has the tree itself and a
    field beside it."""
    stage, _ = root_of(built[0])
    schema.author(stage, "/t/Ball", ground(50))
    simulation = stage.DefinePrim("/Sim", "SplatSim")
    Usd.CollectionAPI.Apply(simulation, "splats").IncludePath("/t")
    members, left_out = splats(stage, simulation)
    assert ([str(each.GetPath()) for each in members], left_out) == (["/t/Ball", "/t/splats"], [])
