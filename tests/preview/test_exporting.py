"""Tests of what is exported of a viewport; the window's tests press its keys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import UsdGeom

from tests.delegate.stages import two_fields
from tests.preview.documents import STATE
from usdsplat import formats
from usdsplat.core.errors import StageError
from usdsplat.interchange.exporting import export_capture
from usdsplat.preview.document import Document
from usdsplat.preview.exporting import export_seen


@pytest.fixture
def guided():
    """A document of which the second field is a guide."""
    stage = two_fields()
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/B")).CreatePurposeAttr("guide")
    document = Document(stage)
    yield document
    document.close()


def read(path):
    return formats.read(path).cloud.positions


@pytest.mark.parametrize(
    ("purposes", "fields"),
    [
        (("default", "render"), "A"),
        (("default", "render", "guide"), "AB"),
        (("guide",), "B"),
    ],
)
def test_the_purposes_of_the_viewport_are_exported(guided, tmp_path, purposes, fields):
    """Oracle: the fields that an engine draws, exported by their names and counted together."""
    guided.engine.set_purposes(purposes)
    guided.engine.sync()
    assert guided.engine.render_scene.prims() == tuple(f"/World/{each}" for each in fields)
    for each in fields:
        path = tmp_path / f"{each}.ply"
        export_capture(guided.stage, path, prim_path=f"/World/{each}")
    said = export_seen(guided, replace(STATE, purposes=purposes), tmp_path / "seen.ply")
    expected = np.concatenate([read(tmp_path / f"{each}.ply") for each in fields])
    np.testing.assert_array_equal(read(tmp_path / "seen.ply"), expected)
    assert f"{len(expected)} splats" in said


@pytest.mark.parametrize(
    ("purposes", "fields"), [(("default", "render"), "A"), (("default", "render", "guide"), "AB")]
)
def test_a_page_has_the_purposes_of_the_viewport(guided, tmp_path, purposes, fields):
    """Oracle: the numbers of splats of the fields, exported by their names."""
    paths = [tmp_path / f"{each}.ply" for each in fields]
    for path in paths:
        export_capture(guided.stage, path, prim_path=f"/World/{path.stem}")
    state = replace(STATE, purposes=purposes, camera=None)
    said = export_seen(guided, state, tmp_path / "seen.html")
    assert f", {sum(len(read(path)) for path in paths)} splats" in said


def test_there_is_nothing_to_export_of_other_purposes(guided, tmp_path):
    """Oracle: the sentence, and no file."""
    with pytest.raises(StageError, match="expected a visible splat field"):
        export_seen(guided, replace(STATE, purposes=("proxy",)), tmp_path / "seen.ply")
    assert not list(tmp_path.iterdir())
