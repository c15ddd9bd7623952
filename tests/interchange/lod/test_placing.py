"""Tests of the places of a tree's files."""

from __future__ import annotations

import pytest

from tests.interchange.lod.worlds import ground
from usdsplat import formats
from usdsplat.core.errors import OutputError, UsdSplatError
from usdsplat.interchange.lod import build_tree


def test_chunks_of_another_tree_are_not_replaced(tmp_path):
    """Oracle: the files of the first tree: `city.usdc` would have the same folder."""
    formats.write(ground(2000), tmp_path / "scan.ply")
    build_tree(tmp_path / "scan.ply", tmp_path / "city.usda")
    before = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()}
    with pytest.raises(OutputError, match=r"found the chunks of city\.usda"):
        build_tree(tmp_path / "scan.ply", tmp_path / "city.usdc")
    build_tree(tmp_path / "scan.ply", tmp_path / "city.usda")  # its own are
    after = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()}
    assert after == before


@pytest.mark.parametrize("name", ["a\tb.usda", "a\udcff.usda"])
def test_names_to_which_no_layer_can_refer_are_refused(tmp_path, name):
    """Oracle: the sentence, and that nothing is written; USD refuses such asset paths."""
    formats.write(ground(500), tmp_path / "scan.ply")
    with pytest.raises(UsdSplatError, match="found a name"):
        build_tree(tmp_path / "scan.ply", tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["scan.ply"]
