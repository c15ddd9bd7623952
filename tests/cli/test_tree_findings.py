"""Tests of what commands say of pictures that draw other nodes of splat trees than asked for."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdRender

from tests.delegate.stages import add_camera
from tests.schema.clouds import cloud
from tests.trees import little_tree, rows_of
from usdsplat import schema
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


@pytest.mark.parametrize("fields", [0, 20])
@pytest.mark.parametrize("command", ["render", "info", "convert"])
def test_a_budget_below_the_roots_is_one_finding(
    tree: Path, capsys: pytest.CaptureFixture, command: str, fields: int
) -> None:
    """Oracle: by hand: the root has 14 splats; of fields, a picture draws one splat at least, and a
    capture has all. With the number in the sentence there is no finding."""
    stage = Usd.Stage.Open(str(tree))
    add_camera(stage, "/tree/Cam", eye=(0.0, 0.0, 9.0))
    if fields:
        schema.author(stage, "/tree/field", rows_of(cloud(n=200, degree=1), slice(fields)))
    stage.Save()
    kept = fields if command == "convert" else min(1, fields)
    words = {
        "render": ["-o", str(tree.with_name("a.png")), *FRAMES[:4]],
        "info": [],
        "convert": [str(tree.with_name("a.ply"))],
    }
    for budget in (5, 14 + kept - 1, 14 + kept):
        flags = ["--camera", "Cam", "--splat-budget", str(budget), "--strict"]
        status = main([command, str(tree), *words[command], *flags])
        said = capsys.readouterr().err
        assert status == (budget < 14 + kept)
        assert said.count("[small-budget]") == status
        expected = f"/tree/Cam: found a splat budget of {budget}, expected at least {14 + kept}, "
        assert not status or expected in said
        assert not (status and list(tree.parent.glob("a.p*")))


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
