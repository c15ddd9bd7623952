"""Tests of chunks that are other files than the tree was built with, or become others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from tests.delegate.stages import add_camera
from tests.delegate.tree_stages import tree_stage
from tests.delegate.tree_stages import write_chunk as write_field
from tests.render.rendering import random_cloud
from tests.trees import little_tree, write_chunk
from usdsplat.core.edit import merge
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate import trees
from usdsplat.render.settings import RenderSettings

LEAVES = RenderSettings(lod_error=0.0, lod_samples=1)


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Files are looked at before every picture."""
    monkeypatch.setattr(trees, "POLL", 0.0)


@pytest.fixture
def path(tmp_path):
    """A stage with a tree that has the digests of its chunks, and a camera."""
    path = little_tree(tmp_path, random_cloud(1, 400), with_digests=True)
    stage = Usd.Stage.Open(str(path))
    add_camera(stage)
    stage.Save()
    return path


def drawn(engine):
    """A picture of the leaves, and the findings on chunks."""
    picture = engine.picture(engine.view("/Camera", resolution=(80, 60)), LEAVES)["color"].copy()
    return picture, [each for each in engine.findings if each.code == "broken-chunk"]


def pictured(path):
    """The same of a new engine."""
    with Engine(Usd.Stage.Open(str(path)), device="cpu") as engine:
        return drawn(engine)


def rewritten(path: Path, cloud, write=write_chunk):
    """Write a chunk again, as a new file."""
    path.unlink()
    write(path, cloud)


def test_swapped_chunks_are_not_drawn(path):
    """Oracle: the picture with files that cannot be read: the root stands for all nodes."""
    whole, findings = pictured(path)
    assert findings == []
    chunks = [path.parent / "tree_chunks" / f"{number:04}.usdc" for number in (1, 2)]
    contents = [chunk.read_bytes() for chunk in chunks]
    for chunk, content in zip(chunks, reversed(contents), strict=True):
        chunk.unlink()
        chunk.write_bytes(content)
    found, (finding,) = pictured(path)
    assert "found in " in finding.message and "the splats of another chunk" in finding.message
    for chunk in chunks:
        chunk.unlink()
        chunk.write_bytes(b"no crate")
    np.testing.assert_array_equal(found, pictured(path)[0])
    assert (found != whole).any()


def test_a_tree_that_was_built_anew_is_drawn_when_the_stage_is_reloaded(path, tmp_path):
    """Oracle: pictures of new engines; the trees have equal numbers of splats."""
    (tmp_path / "new").mkdir()
    other = little_tree(tmp_path / "new", random_cloud(2, 400), with_digests=True)
    with Engine(stage := Usd.Stage.Open(str(path)), device="cpu") as engine:
        drawn(engine)
        for chunk in (other.parent / "tree_chunks").iterdir():
            (path.parent / "tree_chunks" / chunk.name).unlink()
            chunk.rename(path.parent / "tree_chunks" / chunk.name)
        found, (finding,) = drawn(engine)
        assert "the splats of another chunk (and 2 more chunks)" in finding.message
        assert not found.any()
        new = Usd.Stage.Open(str(other))
        add_camera(new)
        new.GetRootLayer().Export(str(path))
        stage.Reload()
        found, findings = drawn(engine)
    assert findings == []
    np.testing.assert_array_equal(found, pictured(path)[0])
    assert found.any()


def test_a_chunk_with_rows_that_no_node_has_may_change(tmp_path):
    """Oracle: the picture of a new engine. With other numbers of rows it may be one of another
    tree, and is not drawn."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    stage.Save()
    leaf = int(np.flatnonzero(tree.table.child_count == 0)[1])
    chunk = tmp_path / "tree_chunks" / f"{leaf:04}.usdc"
    own, more = tree.clouds[leaf], random_cloud(7, 5)
    rewritten(chunk, merge([own, more]), write_field)
    with Engine(stage, device="cpu") as engine:
        before, findings = drawn(engine)
        assert findings == []
        faint = replace(own, opacities=own.opacities * np.float32(0.1))
        rewritten(chunk, merge([faint, more]), write_field)
        after, findings = drawn(engine)
        assert findings == [] and (after != before).any()
        np.testing.assert_array_equal(after, pictured(tmp_path / "tree.usda")[0])
        rewritten(chunk, merge([faint, more, more]), write_field)
        _, (finding,) = drawn(engine)
    assert (
        f"{len(own) + 10} splats after a change of the file, expected {len(own) + 5} as before"
        in (finding.message)
    )
