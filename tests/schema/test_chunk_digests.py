"""Tests of the digests by which a tree knows its chunks."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from tests.schema.clouds import cloud
from tests.trees import authored, changed, little_tree, tree_of, write_chunk
from usdsplat import formats, schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.schema.chunks import ChunkReader, chunk_digest, chunk_shape
from usdsplat.schema.tree import author_digests, author_tree, read_tree


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return little_tree(tmp_path, cloud(n=200, degree=1), with_digests=True)


def swapped(one: Path, other: Path) -> None:
    """Exchange two files."""
    between = one.with_name("between")
    one.rename(between)
    other.rename(one)
    between.rename(other)


def test_a_digest_is_that_of_the_arrays(tmp_path: Path) -> None:
    """Oracle: hashlib, over the values that NumPy has of them."""
    digest = write_chunk(tmp_path / "a.usdc", whole := cloud(n=9), form="float")
    found = hashlib.sha256(b"3")
    order = (whole.positions, whole.rotations[:, [1, 2, 3, 0]], whole.scales)
    names = ("positions", "orientations", "scales", "opacities")
    for name, array in zip(names, (*order, whole.opacities), strict=True):
        found.update(f"\0{name} float32 {array.shape}\0".encode() + array.tobytes())
    sh = whole.sh.reshape(-1, 3)
    name = "radiance:sphericalHarmonicsCoefficients"
    found.update(f"\0{name} float32 {sh.shape}\0".encode() + sh.tobytes())
    assert digest == found.hexdigest()[:32] == chunk_digest(str(tmp_path / "a.usdc"))


@pytest.mark.parametrize("form", ["packed", "float", "half"])
def test_every_splat_is_in_the_digest(tmp_path: Path, form: schema.Form) -> None:
    """Oracle: equal splats have equal digests, whatever the file; each change gives another."""
    digests = [write_chunk(tmp_path / f"{n}.usdc", cloud(n=9), form=form) for n in range(2)]
    assert digests[0] == digests[1]
    if form == "half":  # a chunk has float arrays, which are compared
        return
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "1.usdc"))
    for each in layer.GetPrimAtPath("/chunk").attributes:
        if isinstance(each.default, Vt.Vec3fArray | Vt.Vec4iArray | Vt.FloatArray):
            before, values = each.default, np.array(each.default)
            values[-1] += 1
            each.default = type(before).FromNumpy(values)
            assert (chunk_digest(str(tmp_path / "1.usdc")) != digests[0]) == (each.name != "extent")
            each.default = before
    assert chunk_digest(str(tmp_path / "1.usdc")) == digests[0]


def test_a_tree_has_the_digests_of_its_chunks(path: Path) -> None:
    """Oracle: the digests of the files; a tree that is authored anew without them has none."""
    tree = tree_of(path)
    assert tree.digests == tuple(map(chunk_digest, tree.chunks)) and len(set(tree.digests)) == 3
    stage = Usd.Stage.Open(str(path))
    session = stage.GetSessionLayer()
    stage.SetEditTarget(session)
    author_tree(stage, "/tree/splats", tree.table, tree.chunk_names, degree=1, drawing=tree.drawing)
    assert read_tree(stage.GetPrimAtPath("/tree/splats")).digests == ()
    with pytest.raises(UsageError, match="digests: found 1, expected 3, one for each chunk"):
        author_digests(stage.GetPrimAtPath("/tree/splats"), ["a"])


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (Vt.StringArray(["a"]), r"chunkDigests: found 1 values, expected 3, one for each chunk"),
        (Vt.TokenArray(["a"] * 3), r"chunkDigests: found a value of type TokenArray, expected str"),
    ],
)
def test_digests_that_lie_are_one_sentence(path: Path, value: object, said: str) -> None:
    """Oracle: the contract of errors."""
    authored(path, "/tree/splats", "splat:chunkDigests", value)
    with pytest.raises(StageError, match=said):
        tree_of(path)


def test_swapped_and_replaced_chunks_are_not_read(path: Path) -> None:
    """Oracle: files of the same number of splats and degree; the sentence."""
    first, second = (path.parent / "tree_chunks" / f"{n:04}.usdc" for n in (1, 2))
    copy = cloud(n=len(schema.read_chunk(str(second)).positions), degree=1, seed=9)
    swapped(first, second)
    tree = tree_of(path)
    reader = tree.reader()
    for chunk in (1, 2):
        with pytest.raises(StageError, match="found the splats of another chunk, expected") as held:
            reader.read(chunk, 0, 10)
        assert held.traceback and Sdf.Layer.Find(tree.chunks[chunk]) is None  # or it is not reread
        with pytest.raises(StageError, match=f"with the digest {tree.digests[chunk]}"):
            chunk_shape(tree.chunks[chunk], tree.digest(chunk))
    swapped(first, second)
    assert len(reader.read(2, 0, 10)) == 10
    second.unlink()
    write_chunk(second, copy)
    with pytest.raises(StageError, match="found the splats of another chunk"):
        reader.read(2, 0, 10)
    layer = Sdf.Layer.FindOrOpen(str(second))
    for data in ({}, {"usdsplat": 3}, {"usdsplat": {"digest": 3}}):
        layer.customLayerData = data
        with pytest.raises(StageError, match="found splats without a digest"):
            reader.read(2, 0, 10)
    changed(path, "splat:chunkDigests", Vt.StringArray([*tree.digests[:2], ""]))
    assert len(tree_of(path).reader().read(2, 0, 10)) == 10


def test_an_edit_in_usd_keeps_the_digest_of_the_tree(path: Path) -> None:
    """Oracle: the splats that are read; only `chunk_digest` looks at them."""
    tree = tree_of(path)
    layer = Sdf.Layer.FindOrOpen(tree.chunks[2])
    layer.GetAttributeAtPath("/chunk.positions").default = Vt.Vec3fArray(199, (1.0, 2.0, 3.0))
    layer.Save()
    assert tree.reader().read(2, 5, 1).positions.tolist() == [[1, 2, 3]]
    assert chunk_digest(tree.chunks[2]) != tree.digests[2]


def test_a_sog_is_not_compared(tmp_path: Path) -> None:
    """Oracle: it has no digest, and is read whatever the tree has."""
    formats.write(cloud(n=9, degree=1), tmp_path / "a.sog")
    name = str(tmp_path / "a.sog")
    assert chunk_digest(name) == "" and chunk_shape(name, "00") == (9, 1)
    assert len(ChunkReader([name], 1, ["00"]).read(0, 0, 9)) == 9
