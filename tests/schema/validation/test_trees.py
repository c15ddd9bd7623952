"""Tests of the checks of splat trees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdValidation, Vt

from tests.schema.clouds import cloud
from tests.trees import changed, little_tree, write_chunk
from usdsplat import schema
from usdsplat.core.findings import Finding
from usdsplat.schema.registration import takes_validators
from usdsplat.schema.validation import TREES, tree_findings

PREFIX = "usdsplat.schema.validation.plugin:"
ROWS = 200


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A sound tree of 200 splats: 26, 50 and 199 rows in three chunks."""
    return little_tree(tmp_path, cloud(n=ROWS, degree=1))


def checked(path: Path) -> list[Finding]:
    """What `validate` says of a stage."""
    return schema.validate(Usd.Stage.Open(str(path)))


def test_a_sound_tree_has_no_findings(path: Path) -> None:
    """Oracle: a tree that `author_tree` wrote, with chunks that `author` wrote."""
    assert checked(path) == []
    assert list(tree_findings(Usd.Stage.Open(str(path)))) == []


def test_missing_chunks_are_one_finding_that_names_the_folder(path: Path) -> None:
    """Oracle: files that are removed, and a folder that is moved."""
    chunks = path.parent / "tree_chunks"
    (chunks / "0001.usdc").unlink()
    (found,) = checked(path)
    assert (found.code, found.severity, found.path) == ("missing-chunk", "error", "/tree/splats")
    assert found.found == "2 of 3 chunks, without 0001.usdc in ./tree_chunks"
    chunks.rename(path.parent / "elsewhere")
    (found,) = checked(path)
    assert found.found == "none of 3 chunks, without 0000.usdc in ./tree_chunks"
    assert list(tree_findings(Usd.Stage.Open(str(path)))) == [found]


def test_a_chunk_that_no_node_uses_may_be_missing(path: Path) -> None:
    """Oracle: a fourth name, which no node has."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    spec = layer.GetAttributeAtPath("/tree/splats.splat:chunks")
    spec.default = Sdf.AssetPathArray([*spec.default, Sdf.AssetPath("./gone.usdc")])
    layer.Save()
    assert checked(path) == []


@pytest.mark.parametrize(
    ("rows", "degree", "said"),
    [
        (198, 1, "198 splats, expected at least 199, for node 6"),
        (199, 2, "harmonics of degree 2, expected 1, as in the tree"),
    ],
)
def test_a_chunk_that_does_not_fit_the_table_is_one_finding(
    path: Path, rows: int, degree: int, said: str
) -> None:
    """Oracle: the number of splats and the degree that were written instead."""
    target = path.parent / "tree_chunks" / "0002.usdc"
    target.unlink()
    write_chunk(target, cloud(n=rows, degree=degree))
    (found,) = checked(path)
    assert (found.code, found.path) == ("broken-chunk", "/tree/splats")
    assert said in found.message and "0002.usdc" in found.message
    assert list(tree_findings(Usd.Stage.Open(str(path)))) == []  # no chunk was opened


def test_several_broken_chunks_are_one_finding(path: Path) -> None:
    """Oracle: two files of noise."""
    for name in ("0000.usdc", "0002.usdc"):
        (path.parent / "tree_chunks" / name).write_bytes(b"noise")
    (found,) = checked(path)
    assert found.code == "broken-chunk" and "(and 1 more chunk)" in found.message


def test_chunks_are_compared_with_their_digests(tmp_path: Path) -> None:
    """Oracle: two files that are swapped, and one whose splats are edited. The first is an error,
    as in pictures; the second a warning, as it is drawn."""
    path = little_tree(tmp_path, cloud(n=200, degree=1), with_digests=True)
    assert checked(path) == []
    one, two = (tmp_path / "tree_chunks" / name for name in ("0001.usdc", "0002.usdc"))
    contents = one.read_bytes(), two.read_bytes()
    for target, content in ((one, contents[1]), (two, contents[0])):
        target.unlink()
        target.write_bytes(content)
    (found,) = checked(path)
    assert (found.code, found.severity) == ("broken-chunk", "error")
    assert "the splats of another chunk (and 1 more chunk)" in found.message
    for target, content in zip((one, two), contents, strict=True):
        target.unlink()
        target.write_bytes(content)
    layer = Sdf.Layer.FindOrOpen(str(two))
    layer.GetAttributeAtPath("/chunk.positions").default = Vt.Vec3fArray(199)
    layer.Save()
    (found,) = checked(path)
    assert (found.code, found.severity, found.path) == ("edited-chunk", "warning", "/tree/splats")
    assert found.found == f"splats of {two} that were changed"


@pytest.mark.parametrize(
    ("attribute", "value", "code"),
    [
        ("splat:nodeErrors", Vt.FloatArray([0.1] * 7), "broken-tree"),
        ("splat:nodeFirstChild", Vt.IntArray([0] * 7), "broken-tree"),
        ("splat:nodeFirstRow", Vt.Int64Array([0] * 7), "broken-tree"),
        ("radiance:sphericalHarmonicsDegree", 7, "broken-tree"),
        ("extent", Vt.Vec3fArray([(0, 0, 0), (1, 1, 1)]), "extent-too-small"),
        ("extent", Vt.Vec3fArray(3), "extent-size"),
        ("colorSpace:name", "nonsense", "unknown-color-space"),
    ],
)
def test_a_wrong_value_is_one_finding(path: Path, attribute: str, value: Any, code: str) -> None:
    """Oracle: the value that was changed in a sound tree."""
    changed(path, attribute, value)
    (found,) = checked(path)
    assert (found.code, found.path) == (code, "/tree/splats")
    early = [each for each in (found,) if code == "broken-tree"]
    assert list(tree_findings(Usd.Stage.Open(str(path)))) == early


def test_a_tree_without_an_extent_is_a_finding(path: Path) -> None:
    """Oracle: USD, which then has no bound of the prim."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    prim = layer.GetPrimAtPath("/tree/splats")
    prim.RemoveProperty(prim.properties["extent"])
    layer.Save()
    assert [each.code for each in checked(path)] == ["no-extent"]


def test_a_tree_in_instances_is_checked_once(path: Path) -> None:
    """Oracle: two instances of one broken tree."""
    changed(path, "splat:nodeErrors", Vt.FloatArray(7))
    stage = Usd.Stage.CreateInMemory()
    for name in ("/A", "/B"):
        prim = stage.DefinePrim(name)
        prim.GetReferences().AddReference(str(path))
        prim.SetInstanceable(True)
    found = [each for each in schema.validate(stage) if each.code == "broken-tree"]
    assert len(found) == 1


@pytest.mark.skipif(not takes_validators(), reason="USD takes validators since 26.5")
def test_the_validator_of_usd_says_the_same(path: Path) -> None:
    """Oracle: `schema.validate`, whose findings the validator lists in camelCase."""
    (path.parent / "tree_chunks" / "0001.usdc").unlink()
    stage = Usd.Stage.Open(str(path))
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadValidatorsByName([PREFIX + TREES])
    (error,) = UsdValidation.ValidationContext(validators).Validate(stage)
    (found,) = schema.validate(stage)
    assert error.GetName() == "missingChunk"
    assert error.GetMessage() == f"{found.message}; {found.cure}"
    schema.author(stage, "/Field", cloud(n=5))
    assert UsdValidation.ValidationContext(validators).Validate(stage)[0].GetName() == (
        "missingChunk"
    )


def test_random_bytes_in_a_chunk_are_found_or_harmless(path: Path) -> None:
    """Oracle: at most one finding, and a sentence; what is harmless can be read."""
    target = path.parent / "tree_chunks" / "0002.usdc"
    whole = np.frombuffer(target.read_bytes(), np.uint8)
    rng = np.random.default_rng(4)
    found_once = 0
    for _ in range(60):
        data = whole.copy()
        places = rng.integers(len(data) - 2500, len(data), 3)
        data[places] = rng.integers(0, 256, 3)
        target.unlink()
        target.write_bytes(data.tobytes())
        found = [each for each in checked(path) if each.code != "missing-chunk"]
        assert len(found) <= 1
        if found:
            found_once += 1
            assert found[0].code == "broken-chunk" and "\n" not in found[0].message
    assert found_once > 3
