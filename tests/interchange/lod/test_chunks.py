"""Tests of the chunks of trees."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf

from tests.interchange.lod.worlds import ground
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.extent import extent
from usdsplat.interchange import files
from usdsplat.interchange.lod import LodOptions, build_tree, chunks
from usdsplat.interchange.lod.chunks import ChunkForm, ChunkNodes
from usdsplat.schema.chunks import chunk_digest

FORM = ChunkForm(
    up_axis="Z",
    meters_per_unit=0.5,
    color_space="lin_ap1_scene",
    drawing=schema.DrawingHints(
        rasterize_mode="classic", sorting_mode="cameraDistance", footprint=0.5
    ),
)
NAMES = ("positions", "scales", "rotations", "opacities", "sh")


@pytest.mark.parametrize(("has_leaves", "mode"), [(True, "classic"), (False, "antialiased")])
def test_a_chunk_is_read_as_it_was_drawn(tmp_path, has_leaves, mode):
    """Oracle: the splats that writing returned, and the reader of packed fields."""
    path = tmp_path / "0001.usdc"
    drawn, digest = chunks.write_chunk(path, ground(200, 2), FORM, has_leaves=has_leaves)
    found = chunks.read_chunk(path)
    assert digest == chunk_digest(str(path))
    for name in NAMES:
        np.testing.assert_array_equal(getattr(found, name), getattr(drawn, name))
    prim = (stage := files.open_stage(path)).GetDefaultPrim()
    assert (str(prim.GetPath()), schema.is_packed(prim)) == ("/splats", True)
    assert (schema.rasterize_mode(prim), schema.color_space(prim)) == (mode, "lin_ap1_scene")
    assert stage.GetMetadata("upAxis") == "Z"
    footprint = 0.5 if has_leaves else None
    assert (schema.sorting_mode(prim), schema.footprint(prim)) == ("cameraDistance", footprint)


def test_what_is_known_of_nodes_is_read_again(tmp_path):
    """Oracle: the values; a chunk without them is not finished."""
    nodes = ChunkNodes(
        proxies=np.array([3, 5]),
        residents=np.array([1, 0]),
        low=np.zeros((2, 3)),
        high=np.ones((2, 3)),
        sizes=np.array([0.0, 0.25]),
        strays=ground(4, 1),
        digest="0123",
    )
    path = tmp_path / "0002.usdc"
    chunks.write_chunk(path, ground(9), FORM, has_leaves=True)
    assert not chunks.is_finished(path)
    chunks.write_nodes(path, nodes)
    assert chunks.is_finished(path)
    found = chunks.read_nodes(path)
    assert found.first_rows.tolist() == [0, 4] and found.digest == "0123"
    for name in ("proxies", "residents", "low", "high", "sizes"):
        np.testing.assert_array_equal(getattr(found, name), getattr(nodes, name))
    for name in NAMES:
        np.testing.assert_array_equal(getattr(found.strays, name), getattr(nodes.strays, name))


def test_boxes_contain_their_groups():
    """Oracle: the extent of each group; an empty one has the empty box."""
    cloud = ground(30)
    low, high = chunks.boxes_of(cloud, np.array([10, 0, 20]))
    for group, rows in ((0, slice(0, 10)), (2, slice(10, 30))):
        box = extent(edit.take(cloud, np.arange(30)[rows]))
        assert (low[group] <= box[0]).all() and (box[1] <= high[group]).all()
        np.testing.assert_allclose([low[group], high[group]], box, atol=1e-3)
    assert np.isposinf(low[1]).all() and np.isneginf(high[1]).all()


def test_a_tree_knows_its_chunks(tmp_path):
    """Oracle: the validator, which computes the digests of all chunks again; an edit of one."""
    formats.write(ground(3000, 1), tmp_path / "scan.ply")
    build_tree(tmp_path / "scan.ply", tmp_path / "t.usda", options=LodOptions(leaf_splats=256))
    stage = files.open_stage(tmp_path / "t.usda")
    digests = schema.read_tree(stage.GetPrimAtPath("/t/splats")).digests
    assert len(set(digests)) == len(digests) > 3
    assert [each for each in schema.validate(stage) if each.severity != "note"] == []
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "t_chunks" / "0002.usdc"))
    attribute = layer.GetAttributeAtPath("/splats.positions")
    attribute.default = attribute.default[::-1]
    assert [each.code for each in schema.validate(stage)] == ["edited-chunk"]
