"""Tests of what commands say of pictures that draw other nodes of splat trees than asked for."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdRender

from tests.schema.clouds import cloud
from tests.trees import little_tree
from usdsplat.cli.main import main

FRAMES = ("--resolution", "64x48", "--device", "cpu", "--frames", "1-2")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A stage with a tree of 200 splats: four leaves, two branches, and a root of 14 splats."""
    return little_tree(tmp_path, cloud(n=200, degree=1))


@pytest.mark.parametrize("flags", [(), ("--deep",)])
def test_an_unfinished_picture_is_one_finding(
    tree: Path, capsys: pytest.CaptureFixture, flags: tuple[str, ...]
) -> None:
    """Oracle: by hand: the four leaves are wanted, and only the root is read for the first
    picture; under --strict nothing is written."""
    command = ["render", str(tree), "-o", str(tree.with_name("a.####.exr")), *FRAMES, *flags]
    command += ["--lod-error", "0", "--lod-samples", "1"]
    assert main([*command, "--no-node-wait", "--strict"]) == 1
    assert not list(tree.parent.glob("*.exr"))
    said = capsys.readouterr().err
    assert main([*command, "--no-node-wait"]) == 0
    said_of_four = "a picture that does not wait for nodes, expected 4 more nodes, not read yet"
    for each in (said, capsys.readouterr().err):
        assert each.count("[unread-nodes]") == 1
        assert said_of_four in each
    assert main(command) == 0
    assert "unread-nodes" not in capsys.readouterr().err


def test_validate_says_that_a_product_does_not_wait(
    tree: Path, capsys: pytest.CaptureFixture
) -> None:
    """Oracle: what `render` says of the product."""
    stage = Usd.Stage.Open(str(tree))
    UsdRender.Product.Define(stage, "/Render/Product").CreateProductNameAttr("a.exr")
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateProductsRel().SetTargets(["/Render/Product"])
    settings.GetPrim().CreateAttribute("splat:nodeWait", Sdf.ValueTypeNames.Bool).Set(False)
    settings.GetPrim().CreateAttribute("splat:lodError", Sdf.ValueTypeNames.Float).Set(0.0)
    stage.Save()
    assert main(["validate", str(tree)]) == 0
    assert "[unread-nodes]" in capsys.readouterr().out
