"""Tests of reading splat trees as captures."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.interchange.samples import read_ply
from tests.schema.clouds import cloud
from tests.trees import little_tree, rows_of, write_chunk
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.interchange import convert, export_capture
from usdsplat.interchange.exporting import export_stage
from usdsplat.interchange.options import ExportOptions, StageReading
from usdsplat.interchange.tree_reading import TreeChoice, tree_reading
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.lod_root_authoring import author_lod_root
from usdsplat.schema.tree_cuts import TreeReading

ARRAYS = ("positions", "scales", "rotations", "opacities", "sh")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A tree of 200 splats with float chunks, which are exact."""
    return little_tree(tmp_path, cloud(n=200, degree=1), form="float")


def reading_of(path: Path, **choice: int) -> tuple[TreeReading, Usd.Stage]:
    """A reading of a little tree, and the stage, which must be held."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath("/tree/splats")
    return tree_reading(prim, TreeChoice(**choice)), stage


def by_place(splats: SplatCloud) -> SplatCloud:
    """The splats in the order of their centres."""
    return rows_of(splats, np.lexsort(splats.positions.T))


def assert_same_splats(ours: SplatCloud, other: SplatCloud) -> None:
    ours, other = by_place(ours), by_place(other)
    for name in ARRAYS:
        expected = getattr(other, name)
        np.testing.assert_allclose(getattr(ours, name), expected, rtol=1e-6, err_msg=name)


def test_the_leaves_and_residents_are_the_capture(path: Path) -> None:
    """Oracle: the cloud that the tree was made from, in another order."""
    reading, stage = reading_of(path)
    assert stage and len(reading) == 200
    assert_same_splats(reading.cloud(), cloud(n=200, degree=1))


def test_packed_chunks_are_the_capture_within_packing(tmp_path: Path) -> None:
    """Oracle: the centres, which packing keeps, and its bound of the opacity."""
    path = little_tree(tmp_path, cloud(n=200, degree=3))
    reading, stage = reading_of(path)
    ours, given = by_place(reading.cloud()), by_place(cloud(n=200, degree=3))
    assert stage
    np.testing.assert_array_equal(ours.positions, given.positions)
    np.testing.assert_allclose(ours.opacities, given.opacities, atol=1 / 1022)


@pytest.mark.parametrize(("level", "count"), [(0, 200), (1, 51), (2, 14)])
def test_a_level_has_the_proxies_of_its_nodes_and_all_residents_above(
    path: Path, level: int, count: int
) -> None:
    """Oracle: rows read from the chunks by the numbers of the helper: chunk 0 has the root and the
    resident, chunk 1 the branches, chunk 2 the leaves."""
    reading, stage = reading_of(path, level=level)
    ours = reading.cloud()
    assert stage and len(ours) == len(reading) == count
    chunks = [
        schema.read_chunk(str(path.parent / "tree_chunks" / f"{row:04}.usdc")) for row in range(3)
    ]
    resident = rows_of(chunks[0], [13])
    whole = {0: chunks[2], 1: chunks[1], 2: rows_of(chunks[0], slice(13))}[level]
    np.testing.assert_array_equal(
        by_place(ours).positions,
        by_place(
            SplatCloud(
                **{
                    name: np.concatenate([getattr(whole, name), getattr(resident, name)])
                    for name in ARRAYS
                }
            )
        ).positions,
    )


def test_a_number_of_splats_is_never_exceeded(path: Path) -> None:
    """Oracle: the numbers of all cuts of the tree: 14, 51, 125, 200 and those with one half
    refined."""
    for most, count in ((14, 14), (50, 14), (51, 51), (199, 126), (200, 200), (10**9, 200)):
        reading, stage = reading_of(path, max_splats=most)
        assert stage and len(reading.cloud()) == len(reading)
        assert len(reading) == pytest.approx(count, abs=1) and len(reading) <= most
    with pytest.raises(StageError, match="found 14 splats at its coarsest level, expected at most"):
        reading_of(path, max_splats=13)


def test_proxies_are_antialiased_and_leaves_as_the_tree_says(tmp_path: Path) -> None:
    """Oracle: the schema's documentation."""
    for mode in ("classic", "antialiased"):
        folder = tmp_path / mode
        folder.mkdir()
        path = little_tree(folder, cloud(n=200), drawing=DrawingHints(rasterize_mode=mode))
        assert reading_of(path)[0].rasterize_mode == mode
        assert reading_of(path, level=1)[0].rasterize_mode == "antialiased"


def test_a_missing_chunk_stops_only_what_needs_it(path: Path) -> None:
    """Oracle: the leaves' chunk, which coarser levels do not read."""
    (path.parent / "tree_chunks" / "0002.usdc").unlink()
    assert len(reading_of(path, level=1)[0].cloud()) == 51
    said = "/tree/splats: found 2 of 3 chunks, without 0002.usdc in ./tree_chunks"
    reading, stage = reading_of(path)
    with pytest.raises(StageError, match=said):
        reading.cloud()
    assert stage


@pytest.mark.parametrize(
    ("rows", "degree", "said"),
    [(100, 1, "found 100 splats, expected at least 199"), (199, 0, "found harmonics of degree 0")],
)
def test_a_chunk_that_does_not_fit_is_one_sentence(
    path: Path, rows: int, degree: int, said: str
) -> None:
    """Oracle: the chunk that was written in its place."""
    target = path.parent / "tree_chunks" / "0002.usdc"
    target.unlink()
    write_chunk(target, cloud(n=rows, degree=degree))
    reading, stage = reading_of(path)
    with pytest.raises(StageError, match=said):
        reading.cloud()
    assert stage


def test_two_names_of_one_layer_are_one_sentence(path: Path) -> None:
    """Oracle: a chunk that is named twice, so that rows could be shared."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    spec = layer.GetAttributeAtPath("/tree/splats.splat:chunks")
    spec.default = Sdf.AssetPathArray([spec.default[2], spec.default[1], spec.default[2]])
    layer.Save()
    with pytest.raises(StageError, match="found chunk 2 in the same layer as chunk 0"):
        reading_of(path)


def test_a_tree_is_exported_in_world_space(path: Path, tmp_path: Path) -> None:
    """Oracle: centres moved by hand; the axes of the stage."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    prim = stage.DefinePrim("/City", "Xform")
    prim.GetReferences().AddReference(str(path))
    UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(5, 0, -1))
    report = export_capture(stage, tmp_path / "out.ply", axes="rub")
    assert (report.splats, report.prim_paths) == (200, ("/City/splats",))
    found = read_ply(tmp_path / "out.ply")["positions"]
    expected = cloud(n=200, degree=1).positions + np.float32([5, 0, -1])
    order, other = np.lexsort(found.T), np.lexsort(expected.T)
    np.testing.assert_allclose(found[order], expected[other], atol=1e-6)


def test_a_tree_that_is_named_is_exported_even_if_it_is_invisible(
    path: Path, tmp_path: Path
) -> None:
    """Oracle: the rule for fields."""
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Imageable(stage.GetPrimAtPath("/tree/splats")).MakeInvisible()
    with pytest.raises(StageError, match="not shown in renders"):
        export_capture(stage, tmp_path / "a.ply")
    report = export_capture(stage, tmp_path / "a.ply", prim_path="/tree/splats")
    assert report.splats == 200


def test_point_instances_of_a_tree_are_exported(path: Path, tmp_path: Path) -> None:
    """Oracle: centres of two instances, moved by hand."""
    stage = Usd.Stage.Open(str(path))
    instancer = UsdGeom.PointInstancer.Define(stage, "/Many")
    instancer.CreatePrototypesRel().SetTargets(["/tree"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(50, 0, 0), (0, 70, 0)])
    choice = StageReading(prim_path="/Many", trees=TreeChoice(level=2))
    report = export_stage(stage, tmp_path / "a.ply", choice, axes="rub")
    assert report.splats == 28
    found = read_ply(tmp_path / "a.ply")["positions"]
    own = reading_of(path, level=2)[0].cloud().positions
    np.testing.assert_allclose(found[:14], own + np.float32([50, 0, 0]), atol=1e-5)
    np.testing.assert_allclose(found[14:], own + np.float32([0, 70, 0]), atol=1e-5)


def test_levels_are_written_by_convert(path: Path, tmp_path: Path) -> None:
    """Oracle: the counts of the levels; also joined with a capture."""
    export = ExportOptions(trees=TreeChoice(level=1))
    assert convert(path, tmp_path / "a.ply", export=export).splats == 51
    assert (
        convert(path, tmp_path / "b.ply", export=ExportOptions(split=True)).parts[0].splats == 200
    )
    both = convert([path, tmp_path / "a.ply"], tmp_path / "c.ply", export=export)
    assert both.splats == 102


def test_a_level_without_an_effect_is_one_sentence(path: Path, tmp_path: Path) -> None:
    """Oracle: a level that the tree does not have, and a stage without a tree."""
    with pytest.raises(UsageError, match="found level 3, expected 0 to 2"):
        export_stage(path, tmp_path / "a.ply", StageReading(trees=TreeChoice(level=3)))
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Field", cloud(n=4))
    with pytest.raises(UsageError, match="found a stage without splat trees"):
        export_stage(stage, tmp_path / "a.ply", StageReading(trees=TreeChoice(level=1)))
    assert not (tmp_path / "a.ply").exists()


def test_a_chunk_is_not_overwritten(path: Path, tmp_path: Path) -> None:
    """Oracle: the bytes of the chunk, which is named like a capture by a link."""
    chunk = path.parent / "tree_chunks" / "0002.usdc"
    link = tmp_path / "out.ply"
    os.link(chunk, link)
    before = chunk.read_bytes()
    for split in (False, True):
        target = tmp_path / ("o.ply" if split else "out.ply")
        if split:
            os.link(chunk, tmp_path / "o_tree.ply")
        with pytest.raises(OutputError, match="a file that is being read"):
            export_stage(path, target, split=split)
    assert chunk.read_bytes() == before


def with_root(path: Path, *, tree: bool) -> Usd.Stage:
    """A stage with an LOD root beside the little tree, which may name it."""
    stage = Usd.Stage.Open(str(path))
    author_lod_root(
        stage,
        "/tree/coarse",
        [cloud(n=5, degree=0), cloud(n=3, degree=0)],
        thresholds=(0.1,),
        drawing=DrawingHints(),
        tree=stage.GetPrimAtPath("/tree/splats") if tree else None,
    )
    return stage


def test_a_tree_is_exported_instead_of_its_lod_root(path: Path, tmp_path: Path) -> None:
    """Oracle: the tree's own splats; a root that no tree names has its default item."""
    assert export_capture(with_root(path, tree=True), tmp_path / "a.ply").prim_paths == (
        "/tree/splats",
    )


def test_the_chosen_item_of_an_lod_root_is_exported(path: Path, tmp_path: Path) -> None:
    """Oracle: the default item, and the one that an override names, which is invisible itself."""
    stage = with_root(path, tree=False)
    report = export_capture(stage, tmp_path / "a.ply")
    assert report.prim_paths == ("/tree/splats", "/tree/coarse/lod0")
    root = stage.GetPrimAtPath("/tree/coarse")
    root.AddAppliedSchema("LODOverrideAPI")
    names = Sdf.ValueTypeNames
    root.CreateAttribute("lod:override:mode", names.Token).Set("indexedLOD")
    root.CreateAttribute("lod:override:index", names.Float).Set(1.0)
    report = export_capture(stage, tmp_path / "b.ply")
    assert report.prim_paths == ("/tree/splats", "/tree/coarse/lod1")
    UsdGeom.Imageable(root).MakeInvisible()
    assert export_capture(stage, tmp_path / "c.ply").prim_paths == ("/tree/splats",)
