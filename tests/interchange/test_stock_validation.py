"""Tests that USD's validators find nothing in any kind of file that is written from a capture."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd, UsdGeom

from tests.interchange.samples import capture
from tests.stock_validation import errors, without_plugin
from usdsplat.core.edits import parsed
from usdsplat.interchange import convert, import_capture, import_sequence
from usdsplat.interchange.options import ImportOptions, SequenceOptions

FORMS = ("float", "half", "packed")
ASSEMBLY = """#usda 1.0
( defaultPrim = "Set"
  metersPerUnit = 1
  upAxis = "Y" )
def Xform "Set" ( kind = "assembly" ) {
  def "Here" ( references = @./NAME@ ) {}
}
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A file of each kind, and for each a stage that refers to it."""
    folder = tmp_path_factory.mktemp("written")
    source = capture(folder)
    for frame in (1, 2):
        capture(folder, f"cap.{frame}.ply", seed=frame, n=3 + frame)
    made = []
    for form in FORMS:
        for suffix in (".usda", ".usdz"):
            for axes, bake in (("rdf", False), ("rub", False), ("rdf", True)):
                made.append(folder / f"{form}_{axes}_{bake}{suffix}")
                options = ImportOptions(form=form, axes=axes, bake_axes=bake)
                import_capture(source, made[-1], options=options)
        made.append(folder / f"{form}_edited.usdc")
        options = ImportOptions(form=form)
        edits = [parsed("scale", "2")]
        convert(folder / "float_rdf_False.usda", made[-1], edits=edits, options=options)
        for clips in (False, True):
            made.append(folder / f"{form}_{clips}.usdc")
            sequence = SequenceOptions(clips=clips)
            import_sequence(folder / "cap.%d.ply", made[-1], options=options, sequence=sequence)
        made.append(folder / f"{form}_on_stage.usda")
        stage = Usd.Stage.CreateNew(str(made[-1]))
        UsdGeom.SetStageUpAxis(stage, "Z")
        UsdGeom.SetStageMetersPerUnit(stage, 0.01)
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Shot").GetPrim())
        for _ in range(2):
            import_capture(source, stage, options=options)
        stage.Save()
    for path in tuple(made):
        made.append(folder / f"in_{path.stem}_{path.suffix[1:]}.usda")
        made[-1].write_text(ASSEMBLY.replace("NAME", path.name))
    return made


def test_with_our_plugin_nothing_is_found(written: list[Path]) -> None:
    """Oracle: all validators of USD, and ours."""
    assert {path.name: found for path in written if (found := errors(path))} == {}


def test_without_our_plugin_nothing_is_found_and_the_proxy_is_seen(written: list[Path]) -> None:
    """Oracle: all validators of USD, and its bounds, in a process that has nothing of ours."""
    told = without_plugin(written)
    assert {path.name: each["errors"] for path, each in told.items() if each["errors"]} == {}
    for path, each in told.items():
        points = (2 if "on_stage" in path.name else 1) if "packed" in path.name else 0
        assert len(each["shown"]) == points, path.name
        assert each["bounded"] == [True, True], path.name
