"""Tests of splat trees that are written as streamed SOG."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Usd

from tests.interchange.lod.test_tree_sources import two_trees
from tests.interchange.lod.worlds import ground
from tests.trees import little_tree
from usdsplat import convert, formats, schema
from usdsplat.core.edits import Edit
from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.interchange import streamed_writing
from usdsplat.interchange.exporting import capture_of
from usdsplat.interchange.options import ExportOptions, StageReading
from usdsplat.interchange.tree_reading import TreeChoice


@pytest.fixture
def target(tmp_path):
    """`lod-meta.json` in a new folder."""
    (tmp_path / "out").mkdir()
    return tmp_path / "out" / "lod-meta.json"


def leaves(node):
    """The leaves of the tree of `lod-meta.json`, which contains their boxes."""
    if "lods" in node:
        yield node
    for child in node.get("children", ()):
        for key, worse in (("min", np.less), ("max", np.greater)):
            assert not worse(child["bound"][key], node["bound"][key]).any()
        yield from leaves(child)


def assert_same_points(found, expected):
    """Two sets of points are equal within the bound of positions: each is the nearest of one."""
    apart = np.linalg.norm(found[:, None] - expected, axis=2)
    nearest = apart.argmin(axis=1)
    assert len(set(nearest.tolist())) == len(found) == len(expected)
    assert apart.min(axis=1).max() < 5e-4


@pytest.mark.parametrize("unit", [1, 1 << 19])
def test_levels_are_those_of_the_tree(tmp_path, target, monkeypatch, unit):
    """Oracle: the export of each level of the tree, at two places, within the bound of positions,
    and the format: ranges are a partition of the files, and boxes contain their splats."""
    monkeypatch.setattr(streamed_writing, "UNIT", unit)
    path = two_trees(tmp_path)
    report = convert(path, target)
    assert (report.splats, report.degree, report.frame) == (400, 1, "rdf")
    stage, meta = Usd.Stage.Open(str(path)), json.loads(target.read_text())
    assert meta["lodLevels"] == 3 and meta["count"] == sum(meta["counts"])
    for level in range(3):
        reading = StageReading(trees=TreeChoice(level=level))
        expected = capture_of(stage, "rdf", reading)[0].cloud
        found = formats.read(target, how=formats.ReadOptions(lod=level))
        assert found.antialiased == (level > 0)
        assert len(expected) == meta["counts"][level]
        assert_same_points(found.cloud.positions, expected.positions)
    clouds = [formats.read(target.parent / name).cloud for name in meta["filenames"]]
    assert (len(clouds) > 3) == (unit == 1)
    taken = [np.zeros(len(cloud), int) for cloud in clouds]
    for leaf in leaves(meta["tree"]):
        assert set(leaf["lods"]) <= {"0", "1", "2"} and "0" in leaf["lods"]
        for each in leaf["lods"].values():
            rows = slice(each["offset"], each["offset"] + each["count"])
            taken[each["file"]][rows] += 1
            positions = clouds[each["file"]].positions[rows]
            assert (positions >= np.array(leaf["bound"]["min"]) - 1e-3).all()
            assert (positions <= np.array(leaf["bound"]["max"]) + 1e-3).all()
    assert all((each == 1).all() for each in taken)


def test_splats_belong_to_leaves_beside_them(tmp_path, target):
    """Oracle: leaves along x, whose boxes do not overlap, but for proxies at their ends."""
    convert(little_tree(tmp_path, ground(400)), target)
    meta = json.loads(target.read_text())
    clouds = [formats.read(target.parent / name).cloud for name in meta["filenames"]]
    middles = {"0": [], "1": [], "2": []}
    for leaf in leaves(meta["tree"]):
        for level, each in leaf["lods"].items():
            rows = slice(each["offset"], each["offset"] + each["count"])
            middles[level].append(np.median(clouds[each["file"]].positions[rows, 0]))
    assert len(middles["2"]) == 4
    for level in ("1", "2"):
        np.testing.assert_allclose(np.sort(middles[level]), np.sort(middles["0"]), atol=0.12)


def test_what_cannot_be_written_is_refused(tmp_path, target):
    """Oracle: what is wrong; the folder stays empty."""
    tree = little_tree(tmp_path, ground(200))
    formats.write(ground(20), tmp_path / "a.ply")
    stage = Usd.Stage.CreateNew(str(tmp_path / "field.usda"))
    schema.author(stage, "/a", ground(20))
    stage.GetRootLayer().Save()
    with pytest.raises(UsageError, match="expected one stage with splat trees"):
        convert(tmp_path / "a.ply", target)
    with pytest.raises(UsageError, match="expected one stage with splat trees"):
        convert([tree, tree], target)
    with pytest.raises(StageError, match="/a: found a splat field, expected splat trees only"):
        convert(tmp_path / "field.usda", target)
    with pytest.raises(UsageError, match="all levels of the trees are written"):
        convert(tree, target, export=ExportOptions(trees=TreeChoice(level=1)))
    with pytest.raises(UsageError, match="all levels of the trees are written"):
        convert(tree, target, edits=(Edit(name="drop-nan"),))
    (tmp_path / "tree_chunks" / "0001.usdc").unlink()
    with pytest.raises(StageError, match=r"0001\.usdc"):
        convert(tree, target)
    assert not list(target.parent.iterdir())
    with pytest.raises(OutputError, match="a folder with other files"):
        convert(tree, tmp_path / "lod-meta.json")
    with pytest.raises(OutputError, match="no such folder"):
        convert(tree, tmp_path / "none" / "lod-meta.json")


def test_a_failure_leaves_no_files(tmp_path, target, monkeypatch):
    """Oracle: an encoder that fails at the second file."""
    calls = []
    encode = streamed_writing.encode

    def failing(*args, **options):
        calls.append(1)
        if len(calls) == 2:
            raise OutputError("x", "a failure", "none")
        return encode(*args, **options)

    monkeypatch.setattr(streamed_writing, "encode", failing)
    with pytest.raises(OutputError, match="a failure"):
        convert(little_tree(tmp_path, ground(200)), target)
    assert len(calls) == 2
    assert not list(target.parent.iterdir())
