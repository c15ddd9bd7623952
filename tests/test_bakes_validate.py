"""Test that USD's validators find nothing in presets and bakes of imported captures."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stock_validation import errors, without_plugin
from usdsplat import formats, main, procedural_capture


@pytest.mark.parametrize("form", ["float", "packed"])
def test_nothing_is_found_in_a_bake_with_or_without_our_plugin(tmp_path: Path, form: str) -> None:
    """Oracle: all validators of USD here, and in a process that has nothing of ours."""
    scan, stage, preset = (tmp_path / name for name in ("a.ply", "a.usda", "sim.usda"))
    formats.write(procedural_capture(2_000), scan)
    flags = ["--packed"] if form == "packed" else []
    assert main(["convert", str(scan), str(stage), "--axes", "rub", *flags]) == 0
    assert main(["simulate", "--preset", "dissolve", str(stage), "-o", str(preset)]) == 0
    written = [stage, preset]
    for mode in ("dense", "clips", "packed"):
        written.append(tmp_path / f"{mode}.usda")
        values = (f"bake:mode={mode}", "dissolve:start=0", "dissolve:speed=9")
        sets = [word for value in values for word in ("--set", value)]
        target = ["-o", str(written[-1]), "--frames", "1:3"]
        assert main(["simulate", str(preset), *target, *sets]) == 0
    assert {path.name: errors(path) for path in written} == {path.name: [] for path in written}
    for path, told in without_plugin(written).items():
        assert told["errors"] == [], path.name
        assert told["bounded"] == [True, True], path.name
        is_packed = form == "packed" or path.stem == "packed"
        assert told["shown"] == (["/a/splats_proxy"] if is_packed else []), path.name
