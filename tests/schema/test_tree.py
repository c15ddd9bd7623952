"""Tests of reading and writing splat trees."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.schema.clouds import cloud
from tests.trees import changed, little_table, little_tree, tree_of
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.extent import extent
from usdsplat.core.node_table import NodeTable, check_nodes
from usdsplat.schema import tokens
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.tree import TREE, author_tree, is_tree, read_chunk, read_tree

CHUNKS = ["./c/0000.usdc", "./c/0001.usdc", "./c/0002.usdc"]
HINTS = DrawingHints(
    rasterize_mode="antialiased",
    projection_mode="tangential",
    sorting_mode="rayHitDistance",
    footprint=0.25,
)


def authored(stage: Usd.Stage, **options: Any) -> Usd.Prim:
    """A tree of the little table."""
    given = {"degree": 2, "drawing": HINTS, "color_space": "lin_ap1_scene", "pixel": 0.125}
    return author_tree(stage, "/Tree", little_table(), CHUNKS, **{**given, **options})


def test_what_is_authored_is_read(stage: Usd.Stage) -> None:
    """Oracle: the arguments of `author_tree`."""
    prim = authored(stage)
    tree = read_tree(prim)
    for field in fields(NodeTable):
        ours, given = getattr(tree.table, field.name), getattr(little_table(), field.name)
        assert ours.dtype == given.dtype
        np.testing.assert_array_equal(ours, given, field.name)
    assert (tree.chunk_names, tree.chunks) == (tuple(CHUNKS), ("", "", ""))
    assert (tree.degree, tree.color_space, tree.pixel) == (2, "lin_ap1_scene", 0.125)
    assert tree.drawing == HINTS


def test_the_prim_is_of_our_type_with_what_the_schema_declares(stage: Usd.Stage) -> None:
    """Oracle: USD's registry, and the types of its definition of the prim."""
    prim = authored(stage)
    assert is_tree(prim) and prim.GetTypeName() == TREE and prim.IsA("ParticleField")
    assert not is_tree(stage.DefinePrim("/Other", "Xform")) and not is_tree(Usd.Prim())
    assert not schema.is_splat_field(prim)
    assert prim.HasAPI("SplatFieldAPI")
    for attribute in prim.GetAuthoredAttributes():
        declared = prim.GetPrimDefinition().GetAttributeDefinition(attribute.GetName())
        spec = attribute.GetPropertyStack(Usd.TimeCode.Default())[0]
        assert spec.typeName == declared.GetTypeName() and not spec.custom, attribute
        assert spec.variability == declared.GetVariability(), attribute
    fallbacks = stage.GetRootLayer().pseudoRoot.GetInfo("fallbackPrimTypes")
    assert list(fallbacks[TREE]) == ["ParticleField"]


def test_a_tree_without_options_has_the_defaults_of_a_field(stage: Usd.Stage) -> None:
    """Oracle: the fallbacks of the schema."""
    tree = read_tree(authored(stage, drawing=DrawingHints(), color_space=None, pixel=0.0))
    assert tree.color_space == tokens.DEFAULT_COLOR_SPACE
    assert tree.drawing == DrawingHints(
        rasterize_mode="classic", projection_mode="perspective", sorting_mode="zDepth"
    )
    assert tree.pixel == 0


def test_the_extent_holds_every_splat_out_to_its_reach(tmp_path: Path) -> None:
    """Oracle: the extent of the cloud that the tree was made from, by `core.extent`."""
    splats = cloud(n=300)
    stage = Usd.Stage.Open(str(little_tree(tmp_path, splats)))
    prim = stage.GetPrimAtPath("/tree/splats")
    low, high = np.asarray(prim.GetAttribute("extent").Get())
    box = extent(splats)
    assert (low <= box[0]).all() and (high >= box[1]).all()
    bound = UsdGeom.Boundable(prim).ComputeWorldBound(Usd.TimeCode.Default(), "default")
    np.testing.assert_array_equal(bound.ComputeAlignedRange().GetMin(), low)


def test_the_extent_of_the_largest_boxes_is_finite(stage: Usd.Stage) -> None:
    """Oracle: boxes at the limits of single precision."""
    limits = np.float32([[-3.402e38], [3.402e38]])
    low, high = (np.broadcast_to(limit, (7, 3)).astype(np.float32) for limit in limits)
    table = replace(little_table(), low=low, high=high)
    prim = author_tree(stage, "/Tree", table, CHUNKS, degree=0, drawing=HINTS)
    assert np.isfinite(prim.GetAttribute("extent").Get()).all()


def test_a_tree_is_read_from_text_and_from_a_crate(tmp_path: Path) -> None:
    """Oracle: the same tree from both."""
    path = little_tree(tmp_path, cloud(n=200))
    crate = tmp_path / "tree.usdc"
    Sdf.Layer.FindOrOpen(str(path)).Export(str(crate))
    text, binary = (tree_of(each) for each in (path, crate))
    assert text.chunks == binary.chunks and all(Path(each).is_file() for each in text.chunks)
    for field in fields(NodeTable):
        column = getattr(text.table, field.name)
        np.testing.assert_array_equal(column, getattr(binary.table, field.name))


def test_a_tree_below_a_reference_finds_its_chunks(tmp_path: Path) -> None:
    """Oracle: the chunks of the tree itself; the stage that refers to it is elsewhere."""
    path = little_tree(tmp_path, cloud(n=200))
    (tmp_path / "shots").mkdir()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shots" / "shot.usda"))
    stage.DefinePrim("/City").GetReferences().AddReference("../tree.usda")
    tree = read_tree(stage.GetPrimAtPath("/City/splats"))
    assert tree.chunks == tree_of(path).chunks


def test_chunks_in_memory_are_found(stage: Usd.Stage) -> None:
    """Oracle: the identifier of an anonymous layer, and one that is closed."""
    layer = Sdf.Layer.CreateAnonymous("chunk.usda")
    names = [layer.identifier, "anon:0x1:gone.usda", ""]
    prim = author_tree(stage, "/Tree", little_table(), names, degree=0, drawing=DrawingHints())
    assert read_tree(prim).chunks == (layer.identifier, "", "")


def test_a_missing_chunk_is_no_error_of_the_table(tmp_path: Path) -> None:
    """Oracle: a file that was removed."""
    path = little_tree(tmp_path, cloud(n=200))
    (tmp_path / "tree_chunks" / "0001.usdc").unlink()
    tree = tree_of(path)
    assert [bool(chunk) for chunk in tree.chunks] == [True, False, True]
    with pytest.raises(StageError, match="chunk: found no file"):
        read_chunk(tree.chunks[1])


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (
            "splat:nodeErrors",
            Vt.IntArray(7),
            "/tree/splats.splat:nodeErrors: found a value of type",
        ),
        ("splat:nodeLow", Vt.Vec3dArray(7), "nodeLow: found a value of type Vec3dArray, expected"),
        ("splat:nodeLow", Vt.FloatArray(21), "nodeLow: found a value of type FloatArray, expected"),
        ("splat:nodeChunk", Vt.Int64Array(7), "nodeChunk: found a value of type Int64Array"),
        ("splat:nodeChunk", "word", "nodeChunk: found a value of type str, expected int"),
        ("splat:nodeChunk", Vt.IntArray(6), "chunk of shape (6,), expected (7,), for 7 nodes"),
        ("splat:nodeErrors", Vt.FloatArray(), "/tree/splats: found low of shape (7, 3), expected"),
        ("splat:chunks", Vt.StringArray(3), "splat:chunks: found a value of type StringArray"),
        ("splat:chunks", Sdf.AssetPathArray(2), "a chunk beyond the 2 that are"),
        ("radiance:sphericalHarmonicsDegree", 9, "HarmonicsDegree: found 9, expected 0 to 4"),
        ("radiance:sphericalHarmonicsDegree", -1, "HarmonicsDegree: found -1, expected 0 to 4"),
        ("splat:lod:pixel", -1.0, "lod:pixel: found -1.0, expected a finite number, at least 0"),
        ("splat:lod:pixel", float("inf"), "lod:pixel: found inf, expected a finite number"),
    ],
)
def test_a_wrong_attribute_is_one_sentence(
    tmp_path: Path, name: str, value: Any, said: str
) -> None:
    """Oracle: the attribute that was changed in a valid tree, of a type that USD lets pass."""
    path = little_tree(tmp_path, cloud(n=200))
    retyped(path, name, value)
    stage = Usd.Stage.Open(str(path))
    with pytest.raises(StageError) as raised:
        read_tree(stage.GetPrimAtPath("/tree/splats"))
    assert said in str(raised.value) and "\n" not in str(raised.value)


def retyped(path: Path, name: str, value: Any) -> None:
    """Author a value of any type for an attribute of the tree."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    prim = layer.GetPrimAtPath("/tree/splats")
    prim.RemoveProperty(prim.properties[name])
    Sdf.AttributeSpec(prim, name, Sdf.GetValueTypeNameForValue(value)).default = value
    layer.Save()


def test_other_prims_are_one_sentence(stage: Usd.Stage) -> None:
    """Oracle: a prim of another type, and none."""
    with pytest.raises(StageError, match="found a prim of type Xform, expected ParticleFieldSplat"):
        read_tree(stage.DefinePrim("/Other", "Xform"))
    with pytest.raises(StageError, match=r"^prim: found"):
        read_tree(Usd.Prim())


def test_nothing_is_written_for_invalid_arguments(stage: Usd.Stage) -> None:
    """Oracle: the stage, which stays empty."""
    table = little_table()
    for wrong in ({"degree": 5}, {"pixel": float("nan")}, {"color_space": "blue"}):
        with pytest.raises(UsageError):
            authored(stage, **wrong)
    with pytest.raises(StageError, match="a chunk beyond the 1 that are"):
        author_tree(stage, "/Tree", table, ["a.usdc"], degree=0, drawing=HINTS)
    table.errors[0] = 0
    with pytest.raises(StageError, match="children, but the error 0"):
        author_tree(stage, "/Tree", table, CHUNKS, degree=0, drawing=HINTS)
    assert not stage.GetPrimAtPath("/Tree")


def test_random_mutations_of_attributes_are_a_tree_or_one_sentence(tmp_path: Path) -> None:
    """Oracle: `check_nodes`, tested elsewhere: what is read passes it again."""
    path = little_tree(tmp_path, cloud(n=64, degree=0))
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath("/tree/splats")
    stage.SetEditTarget(stage.GetSessionLayer())
    rng = np.random.default_rng(5)
    names = list(tokens.NODE_COLUMNS)
    accepted = 0
    for _ in range(200):
        attribute = prim.GetAttribute(names[rng.integers(len(names))])
        numbers = np.array(attribute.Get())
        numbers.flat[rng.integers(numbers.size)] = rng.integers(-3, 40)
        attribute.Set(type(attribute.Get()).FromNumpy(numbers[: rng.integers(5, 9)]))
        try:
            tree = read_tree(prim)
        except StageError as error:
            assert "\n" not in str(error)
            stage.GetSessionLayer().Clear()
        else:
            accepted += 1
            check_nodes(tree.table, "tree", chunks=len(tree.chunks))
    assert 5 < accepted < 195


def test_edits_on_disk_are_seen_after_a_reload(tmp_path: Path) -> None:
    """Oracle: the value that was written."""
    path = little_tree(tmp_path, cloud(n=64, degree=0))
    changed(path, "splat:lod:pixel", 0.5)
    stage = Usd.Stage.Open(str(path))
    assert read_tree(stage.GetPrimAtPath("/tree/splats")).pixel == 0.5
