"""Tests of findings about bakes."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Vt

from tests.sim.stage.bakes import PATH, shot
from usdsplat.products.summary import of_stage
from usdsplat.sim.stage.bake_findings import bake_findings

SPAN = Vt.DoubleArray([1, 4])
DAMAGED = " with a damaged record"


@pytest.mark.parametrize(
    ("entry", "words", "described"),
    [
        ({}, DAMAGED, (None, None)),
        ({"frameRange": Vt.StringArray(["a", "b"]), "completedFrames": 1}, DAMAGED, (None, None)),
        ({"frameRange": Vt.DoubleArray([1]), "completedFrames": 1}, DAMAGED, (None, None)),
        ({"frameRange": SPAN, "completedFrames": "x"}, DAMAGED, ([1, 4], None)),
        ({"frameRange": SPAN, "completedFrames": 1}, ", with 1 frame complete", ([1, 4], "1 of 4")),
    ],
)
def test_a_damaged_record_is_a_finding(
    tmp_path: Path, entry: dict[str, object], words: str, described: tuple[object, object]
) -> None:
    """Oracle: the words; the summary of the field has None for what is damaged."""
    stage = shot(tmp_path).stage
    record = {"usdsplat": {"bake": {"checkpoint": "x", **entry}}}
    stage.GetRootLayer().customLayerData = record
    stage.GetPrimAtPath(PATH).SetCustomData(record)
    (found,) = bake_findings(stage)
    assert (found.code, found.found) == (
        "unfinished-bake",
        f"shot.usda, an interrupted bake{words}",
    )
    (field,) = of_stage(stage, None)["fields"]
    assert (field["bake"]["frames"], field["bake"]["completed"]) == described
