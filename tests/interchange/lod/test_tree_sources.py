"""Tests of splat trees and streamed SOG as inputs of a tree."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from tests.interchange.lod.worlds import NAMES, ground, in_parts
from tests.trees import little_tree
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.errors import StageError
from usdsplat.core.progress import silent
from usdsplat.interchange.exporting import capture_of
from usdsplat.interchange.lod import LodOptions, build_tree, tree_rows
from usdsplat.interchange.lod.inputs import open_source
from usdsplat.interchange.lod.streamed_source import StreamedSource


def two_trees(folder):
    """A stage with a tree of 200 splats at two places, turned."""
    little_tree(folder, ground(200, 1))
    stage = Usd.Stage.CreateNew(str(folder / "two.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    for name in ("a", "b"):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}")
        prim.GetPrim().GetReferences().AddReference("./tree.usda")
        prim.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5 * (name == "b")))
        prim.AddRotateXYZOp().Set(Gf.Vec3f(20, 30, 40))
    stage.GetRootLayer().Save()
    return folder / "two.usda"


@pytest.mark.parametrize("window", [13, 1 << 19])
def test_a_tree_is_read_in_parts(tmp_path, monkeypatch, window):
    """Oracle: the export of the leaves and residents of the same stage, whole."""
    monkeypatch.setattr(tree_rows, "WINDOW", window)
    path = two_trees(tmp_path)
    expected = capture_of(Usd.Stage.Open(str(path)), "rub")[0].cloud
    source = open_source(path, LodOptions())
    told = source.survey(silent)
    assert (told.parts, told.degree) == ((200, 200), 1)
    assert {each.name for each in source.files} >= {"two.usda", "tree.usda", "0002.usdc"}
    found = in_parts(source, told.parts, 37)
    for name in NAMES:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)
    np.testing.assert_allclose(told.low, expected.positions.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(told.high, expected.positions.max(axis=0), atol=1e-6)


def test_a_tree_of_trees_has_all_their_splats(tmp_path):
    """Oracle: the export of the inputs, in any order, within the error of packing."""
    path = two_trees(tmp_path)
    expected = capture_of(Usd.Stage.Open(str(path)), "rub")[0].cloud
    target = tmp_path / "new.usda"
    report = build_tree([path], target, options=LodOptions(leaf_splats=256))
    assert report.splats == 400 and report.levels > 1
    found = capture_of(Usd.Stage.Open(str(target)), "rub")[0].cloud
    positions = [each.positions[np.lexsort(each.positions.T)] for each in (found, expected)]
    np.testing.assert_allclose(*positions, atol=1e-5)


def test_a_tree_without_a_chunk_is_refused(tmp_path):
    """Oracle: the file that was removed; nothing is written."""
    path = two_trees(tmp_path)
    (tmp_path / "tree_chunks" / "0002.usdc").unlink()
    with pytest.raises(StageError, match=r"0002\.usdc"):
        build_tree([path], tmp_path / "new.usda")
    assert not (tmp_path / "new.usda").exists()


def test_a_broken_instance_of_a_tree_is_refused(tmp_path):
    """Oracle: a table whose arrays have different lengths."""
    path = two_trees(tmp_path)
    stage = Usd.Stage.Open(str(path))
    stage.GetPrimAtPath("/World/b/splats").GetAttribute("splat:nodeErrors").Set(Vt.FloatArray([1]))
    stage.GetRootLayer().Save()
    with pytest.raises(StageError, match="found low of shape"):
        open_source(path, LodOptions())


def test_a_streamed_sog_is_read_in_parts(tmp_path, monkeypatch):
    """Oracle: the reader of the finest level, and the file of the environment."""
    monkeypatch.setattr(tree_rows, "WINDOW", 11)
    for name, count, degree in (("fine", 60, 1), ("coarse", 20, 0), ("far", 15, 0)):
        formats.write(ground(count, degree, seed=count), tmp_path / f"{name}.sog")
    lods = [{"file": 0, "offset": 0, "count": 60}, {"file": 1, "offset": 0, "count": 20}]
    meta = {
        "lodLevels": 2,
        "filenames": ["fine.sog", "coarse.sog"],
        "environment": "far.sog",
        "tree": {"lods": {str(level): each for level, each in enumerate(lods)}},
    }
    (tmp_path / "lod-meta.json").write_text(json.dumps(meta))
    source = open_source(tmp_path, LodOptions(axes="rdf"))
    assert isinstance(source, StreamedSource)
    told = source.survey(silent)
    assert (told.parts, told.degree, told.frame) == ((75,), 1, "rdf")
    source.release()
    parts = [formats.read(tmp_path / name).cloud for name in ("fine.sog", "far.sog")]
    expected = edit.merge(parts)
    found = in_parts(source, told.parts, 31)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_allclose(told.low, expected.positions.min(axis=0))
