"""Tests of opening a stage: variants, muted layers, masks, session layers, captures."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.cli import stages
from usdsplat.cli.main import main
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import StageError, UsageError

REPORTER = Reporter(ReportingOptions())
open_stage_or_capture = partial(stages.open_stage_or_capture, reporter=REPORTER)


open_stage = partial(stages.open_stage, reporter=REPORTER)


@pytest.fixture
def layered(tmp_path):
    """A stage with a sublayer that says 2 where the root says nothing, and a variant set."""
    strong = Sdf.Layer.CreateNew(str(tmp_path / "strong.usda"))
    weak = Sdf.Layer.CreateNew(str(tmp_path / "weak.usda"))
    root = Sdf.Layer.CreateNew(str(tmp_path / "root.usda"))
    root.subLayerPaths = ["./strong.usda", "./weak.usda"]
    for layer, value in ((strong, 3.0), (weak, 2.0)):
        edit = Usd.Stage.Open(layer)
        UsdGeom.Sphere.Define(edit, "/World/Ball").GetRadiusAttr().Set(value)
        layer.Save()
    stage = Usd.Stage.Open(root)
    prim = UsdGeom.Xform.Define(stage, "/World/Tree").GetPrim()
    seasons = prim.GetVariantSets().AddVariantSet("season")
    for name in ("summer", "autumn"):
        seasons.AddVariant(name)
        seasons.SetVariantSelection(name)
        with seasons.GetVariantEditContext():
            stage.DefinePrim(f"/World/Tree/{name}")
    seasons.SetVariantSelection("summer")
    root.Save()
    return tmp_path / "root.usda"


def radius(stage):
    return stage.GetPrimAtPath("/World/Ball").GetAttribute("radius").Get()


def test_variants_are_selected_without_touching_a_file(layered):
    """Oracle: the prims that each variant holds, and the bytes of the file."""
    before = layered.read_bytes()
    stage = open_stage(layered, StageOptions(variant=("/World/Tree:season=autumn",)))
    assert stage.GetPrimAtPath("/World/Tree/autumn")
    assert not stage.GetPrimAtPath("/World/Tree/summer")
    assert not stage.GetRootLayer().dirty
    assert layered.read_bytes() == before


def test_muted_layers_say_nothing(layered):
    """Oracle: the value of the layer below; a pattern may match part of a name."""
    assert radius(open_stage(layered, StageOptions())) == 3.0
    assert radius(open_stage(layered, StageOptions(mute=(r"stro.*usda$",)))) == 2.0


def test_a_mask_loads_only_what_it_names(layered):
    """Oracle: the paths of the stage; what must be kept is."""
    stage = open_stage(layered, StageOptions(mask=("/World/Tree",)))
    assert stage.GetPrimAtPath("/World/Tree/summer")
    assert not stage.GetPrimAtPath("/World/Ball")
    stage = open_stage(layered, StageOptions(mask=("/World/Tree",)), keep=("/World/Ball",))
    assert stage.GetPrimAtPath("/World/Ball")


def test_a_session_layer_is_stronger_than_the_stage(layered, tmp_path):
    """Oracle: the value in the session layer, whose file stays as it is."""
    session = Usd.Stage.CreateNew(str(tmp_path / "session.usda"))
    UsdGeom.Sphere.Define(session, "/World/Ball").GetRadiusAttr().Set(9.0)
    session.GetRootLayer().Save()
    before = (tmp_path / "session.usda").read_bytes()
    options = StageOptions(
        session_layer=tmp_path / "session.usda", variant=("/World/Tree:season=autumn",)
    )
    assert radius(open_stage(layered, options)) == 9.0
    assert (tmp_path / "session.usda").read_bytes() == before


@pytest.mark.parametrize(
    ("options", "kind", "sentence"),
    [
        (StageOptions(variant=("season=autumn",)), UsageError, "expected /Prim:set=name"),
        (StageOptions(variant=("/No:a=b",)), StageError, "found no prim /No"),
        (StageOptions(variant=("/World/Tree:age=1",)), StageError, "one of its sets: season"),
        (StageOptions(variant=("/World/Ball:age=1",)), StageError, "one of its sets: none"),
        (StageOptions(variant=("/World/Tree:season=x",)), StageError, "one of .*autumn"),
        (StageOptions(mute=("([",)), UsageError, "a regular expression"),
        (StageOptions(mute=("nonesuch",)), StageError, r"strong\.usda, weak\.usda"),
        (StageOptions(mute=(r"root\.usda$",)), StageError, r"strong\.usda, weak\.usda"),
        (StageOptions(mask=("World",)), UsageError, "the path of a prim"),
        (StageOptions(mask=("/World.a",)), UsageError, "the path of a prim"),
        (StageOptions(mask=("//",)), UsageError, "the path of a prim"),
        (StageOptions(session_layer=Path("no.usda")), StageError, "no.usda: found no such file"),
    ],
)
def test_options_that_cannot_be_met_are_one_sentence(layered, options, kind, sentence):
    """Oracle: where: found X, expected Y, with what there is to choose from."""
    with pytest.raises(kind, match=sentence):
        open_stage(layered, options)


@pytest.mark.parametrize("text", [b"#usda 1.0\ndef Xform {", b"not USD at all", b""])
def test_a_broken_file_is_one_sentence(tmp_path, text, capfd):
    """Oracle: one line without a line break in it, and nothing printed by USD itself."""
    (tmp_path / "a.usda").write_bytes(text)
    with pytest.raises(StageError, match=r"a\.usda: found .+, expected a USD file") as caught:
        open_stage(tmp_path / "a.usda", StageOptions())
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_capture_is_a_stage_in_memory(capture):
    """Oracle: the splats of the capture on the only field there is."""
    stage = open_stage_or_capture(capture, StageOptions())
    (prim,) = (prim for prim in stage.Traverse() if schema.is_splat_field(prim))
    assert len(schema.fetch(prim)) == 300
    assert stage.GetRootLayer().anonymous


def test_a_capture_has_no_variants(capture):
    """Oracle: one sentence rather than an option that does nothing."""
    with pytest.raises(UsageError, match=r"--mute: found a capture, .+, expected a stage"):
        open_stage_or_capture(capture, StageOptions(mute=("x",)))


def test_usd_says_nothing_and_we_say_one_sentence(layered, capfd):
    """Oracle: a muted sublayer is what was asked for; a missing one is named once, not by USD."""
    assert main(["info", str(layered), "--mute", "strong", "-q"]) == 0
    assert capfd.readouterr().err == ""
    root = Sdf.Layer.FindOrOpen(str(layered))
    root.subLayerPaths.append("./gone.usda")
    root.Save()
    capfd.readouterr()
    assert main(["info", str(layered)]) == 0
    _, err = capfd.readouterr()
    assert len(err.splitlines()) == 1
    assert err.startswith("usdsplat: error [missing-asset] /: found no sublayer ")
    assert "gone.usda" in err


def test_a_muted_reference_is_not_remarked_on(layered, tmp_path, capfd):
    """Oracle: a layer that is referenced, muted: it was asked for."""
    stage = Usd.Stage.Open(str(layered))
    stage.DefinePrim("/Ref").GetReferences().AddReference("./weak.usda", "/World")
    stage.GetRootLayer().Save()
    del stage
    capfd.readouterr()
    assert main(["info", str(layered), "--mute", "weak", "-v"]) == 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(("name", "found"), [("ball.ply", "a capture"), (".", "a directory")])
def test_what_is_no_stage_is_called_by_its_name(capture, name, found):
    """Oracle: where: found X, expected Y."""
    with pytest.raises(StageError, match=f"found {found}, expected a USD file"):
        open_stage(capture.parent / name, StageOptions())
