"""Tests of descriptions of splat trees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pxr import Usd, UsdUtils, Vt

from tests.schema.clouds import cloud
from tests.trees import changed, little_tree
from usdsplat.products import tree_summary
from usdsplat.schema.hints import DrawingHints


def described(path: Path) -> dict[str, Any]:
    """The description of a little tree."""
    stage = Usd.Stage.Open(str(path))
    return tree_summary.of_tree(stage.GetPrimAtPath("/tree/splats"), None)


def test_levels_counts_errors_and_bytes(tmp_path: Path) -> None:
    """Oracle: 200 splats: one resident, leaves of 199, a quarter of each half, a quarter of those;
    the sizes of the files."""
    told = described(little_tree(tmp_path, cloud(n=200, degree=1), pixel=0.5))
    assert (told["path"], told["type"]) == ("/tree/splats", "ParticleFieldSplatTree")
    assert (told["splats"], told["sh_degree"], told["nodes"]) == (200, 1, 7)
    assert (told["residents"], told["chunks"], told["chunks_missing"]) == (1, 3, 0)
    assert told["levels"] == [
        {"level": 0, "nodes": 4, "splats": 200, "error": 0.0},
        {"level": 1, "nodes": 2, "splats": 51, "error": pytest.approx(0.1)},
        {"level": 2, "nodes": 1, "splats": 14, "error": pytest.approx(0.2)},
    ]
    size = sum(file.stat().st_size for file in (tmp_path / "tree_chunks").iterdir())
    assert (told["bytes"], told["bytes_per_splat"]) == (size, size / 200)
    assert told["filtered_pixel"] == 0.5


def test_hints_and_missing_chunks(tmp_path: Path) -> None:
    """Oracle: what was authored, and a file that was removed."""
    hints = DrawingHints(rasterize_mode="antialiased", footprint=0.25)
    path = little_tree(tmp_path, cloud(n=64), drawing=hints, color_space="lin_ap1_scene")
    (tmp_path / "tree_chunks" / "0002.usdc").unlink()
    told = described(path)
    assert (told["rasterize_mode"], told["footprint"]) == ("antialiased", 0.25)
    assert (told["color_space"], told["filtered_pixel"]) == ("lin_ap1_scene", None)
    assert told["chunks_missing"] == 1
    assert told["bytes"] == sum(f.stat().st_size for f in (tmp_path / "tree_chunks").iterdir())


def test_chunks_in_a_package_have_their_own_size(tmp_path: Path) -> None:
    """Oracle: the sizes of the files that were packed."""
    path = little_tree(tmp_path, cloud(n=64))
    size = described(path)["bytes"]
    package = tmp_path / "tree.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(package))
    told = described(package)
    assert (told["bytes"], told["chunks_missing"]) == (size, 0)
    assert size > 0


def test_a_broken_tree_is_described_by_its_problem(tmp_path: Path) -> None:
    """Oracle: the number that was changed."""
    path = little_tree(tmp_path, cloud(n=64))
    changed(path, "splat:nodeErrors", Vt.FloatArray(7))
    assert "children, but the error 0" in described(path)["problem"]
