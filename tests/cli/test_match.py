"""Tests of `usdsplat match`, from the command line to the graded picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests import chart
from tests.cli.test_main import shell
from usdsplat import schema
from usdsplat.core.grade import Grade
from usdsplat.images.color import convert
from usdsplat.images.match import apply_grade
from usdsplat.images.science import colour_science

pytestmark = pytest.mark.usefixtures("compiled")

GRADE: dict[str, Any] = {"exposure": 0.4, "temperature": 5000.0, "tint": 0.004}


@pytest.fixture
def capture_stage(tmp_path: Path) -> Path:
    """The chart, captured too dark and under the wrong light, as a file."""
    path = tmp_path / "in" / "chart.usda"
    path.parent.mkdir()
    stage = chart.chart_stage(Usd.Stage.CreateNew(str(path)))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    stage.GetRootLayer().Save()
    return path


def graded_picture(path: Path, **grade: Any) -> np.ndarray:
    """What the chart looks like with a grade, linear."""
    stage = Usd.Stage.Open(str(path), load=Usd.Stage.LoadAll)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        schema.author_grade(stage.GetPrimAtPath(chart.FIELD), **grade)
    return chart.picture(stage, color_mode="scene")


def write(path: Path, image: np.ndarray, space: str = "lin_rec709_scene") -> Path:
    """A float EXR that names its colour space."""
    buffer = oiio.ImageBuf(np.ascontiguousarray(image))
    buffer.specmod().attribute("colorInteropID", space)
    assert buffer.write(str(path))
    return path


@pytest.fixture
def plate(tmp_path: Path, capture_stage: Path) -> Path:
    """What the chart should look like."""
    return write(tmp_path / "plate.exr", graded_picture(capture_stage, **GRADE))


def test_a_plate_gives_its_grade(run_json, tmp_path, capture_stage, plate) -> None:
    """Oracle: the grade that the plate was made with; the picture of the result is the plate."""
    target = tmp_path / "graded.usda"
    before = capture_stage.read_bytes()
    report = run_json(
        "match", capture_stage, "-o", target, "--reference", plate, "--fit", "exposure,whiteBalance"
    )
    assert capture_stage.read_bytes() == before
    assert report["prim_paths"] == [chart.FIELD]
    assert report["exposure"] == pytest.approx(GRADE["exposure"], abs=1e-3)
    assert report["temperature"] == pytest.approx(GRADE["temperature"], rel=1e-3)
    assert report["tint"] == pytest.approx(GRADE["tint"], abs=1e-4)
    assert report["delta_e"]["before"]["mean"] > 5
    assert report["delta_e"]["after"]["mean"] < 0.05
    stage = Usd.Stage.Open(str(target))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/World"
    found = chart.picture(stage, color_mode="scene")
    wanted = graded_picture(capture_stage, **GRADE)
    np.testing.assert_allclose(chart.patches(found), chart.patches(wanted), atol=2e-3)


def test_it_is_said_which_space_a_plate_was_taken_for(run, tmp_path, capture_stage, plate):
    """Oracle: the tag of the plate, the flag, and a plate without any, which is linear Rec.709."""
    untagged = tmp_path / "untagged.exr"
    assert oiio.ImageBuf(np.ascontiguousarray(oiio.ImageBuf(str(plate)).get_pixels())).write(
        str(untagged)
    )
    space = ("--reference-space", "lin_rec709_scene")
    for name, flags, source in (
        (plate, (), "as the file states"),
        (untagged, space, "as given"),
        (untagged, (), "assumed, because the file names none"),
    ):
        words = (capture_stage, "-o", tmp_path / "a.usda", "--reference", name, *flags)
        status, out, err = run("match", *words, "--fit", "exposure")
        assert status == 0
        assert f"  plate        lin_rec709_scene, {source}" in out.splitlines()
        assert ("note [assumed-space]" in err) == source.startswith("assumed")


def test_the_result_is_a_layer_of_overs_that_can_be_moved(tmp_path, capture_stage, plate) -> None:
    """A process of its own prints nothing else. Oracle: the specs of the layer, and its only
    sublayer, relative."""
    target = tmp_path / "graded.usdc"
    done = shell("match", capture_stage, "-o", target, "--reference", plate)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{target}: 1 field graded by ")
    assert "ΔE2000" in done.stdout
    layer = Sdf.Layer.FindOrOpen(str(target))
    assert list(layer.subLayerPaths) == ["./in/chart.usda"]
    prim = layer.GetPrimAtPath(chart.FIELD)
    assert prim.specifier == Sdf.SpecifierOver
    assert {item.name for item in prim.properties} == schema.GRADE_ATTRIBUTES
    assert Usd.Stage.Open(layer).GetPrimAtPath(chart.FIELD).HasAPI("SplatGradeAPI")


def test_a_chart_gives_its_colours(run_json, tmp_path, capture_stage) -> None:
    """Oracle: colour-science's chart; the capture was a stop darker and warmer."""
    stage = Usd.Stage.Open(str(capture_stage))
    # the chart's cyan is outside of sRGB, where nothing would be linear any more
    linear = np.clip(chart.chart_linear(), 0.01, 1.0)
    wrong = apply_grade(linear, Grade(exposure=-1.0, temperature=8500.0))
    codes = colour_science().models.eotf_inverse_sRGB(np.clip(wrong, 0.0, 1.0))
    schema.author(stage, chart.FIELD, chart.chart_cloud(codes))
    stage.GetRootLayer().Save()
    patches = tmp_path / "patches.json"
    patches.write_text(json.dumps(chart.regions()))
    target = tmp_path / "graded.usda"
    report = run_json(
        "match", capture_stage, "-o", target, "--chart", "classic24", "--patches", patches,
        "--camera", "Cam", "--resolution", f"{chart.SIZE[0]}x{chart.SIZE[1]}",
    )  # fmt: skip
    assert (report["kind"], report["samples"]) == ("patches", 24)
    assert report["delta_e"]["before"]["mean"] > 10
    assert report["delta_e"]["after"]["mean"] < 1.0
    found = chart.patches(chart.picture(Usd.Stage.Open(str(target)), color_mode="scene"))
    assert chart.delta_e(found, chart.chart_linear()).mean() < 1.0


def test_an_older_grade_is_replaced(run_json, tmp_path, capture_stage, plate) -> None:
    """Oracle: what is found without one."""
    first = run_json("match", capture_stage, "-o", tmp_path / "a.usda", "--reference", plate)
    stage = Usd.Stage.Open(str(capture_stage))
    schema.author_grade(stage.GetPrimAtPath(chart.FIELD), saturation=0.2, exposure=3.0)
    stage.GetRootLayer().Save()
    again = run_json("match", capture_stage, "-o", tmp_path / "b.usda", "--reference", plate)
    assert {**again, "target": ""} == {**first, "target": ""}


def test_only_the_chosen_field_is_graded(run_json, tmp_path, capture_stage, plate) -> None:
    """A second field before some patches. Oracle: the grade of the plate, and the layer's prims."""
    stage = Usd.Stage.Open(str(capture_stage))
    other = schema.author(stage, "/World/Other", chart.chart_cloud(np.full((3, 3), 0.5)))
    UsdGeom.Xformable(other).AddTranslateOp().Set((0, 0, 1))
    stage.GetRootLayer().Save()
    target = tmp_path / "graded.usda"
    report = run_json(
        "match", capture_stage, "-o", target, "--reference", plate, "--prim", chart.FIELD,
        "--fit", "exposure,whiteBalance",
    )  # fmt: skip
    assert report["prim_paths"] == [chart.FIELD]
    assert report["exposure"] == pytest.approx(GRADE["exposure"], abs=1e-3)
    layer = Sdf.Layer.FindOrOpen(str(target))
    assert not layer.GetPrimAtPath("/World/Other")


def test_other_things_in_the_picture_do_not_count(run_json, tmp_path, capture_stage, plate) -> None:
    """A strange patch and a hole. Oracle: the grade that the rest was made with."""
    image = oiio.ImageBuf(str(plate)).get_pixels(oiio.FLOAT)
    x0, y0, x1, y1 = chart.regions()[7]
    image[y0 - 4 : y1 + 4, x0 - 4 : x1 + 4, :3] = (3.0, 0.1, 0.1)
    image[:, :16] = 0.0
    report = run_json(
        "match", capture_stage, "-o", tmp_path / "graded.usda",
        "--reference", write(tmp_path / "strange.exr", image), "--fit", "exposure,whiteBalance",
    )  # fmt: skip
    assert report["exposure"] == pytest.approx(GRADE["exposure"], abs=2e-3)
    assert report["temperature"] == pytest.approx(GRADE["temperature"], rel=2e-3)
    assert report["used"] < report["samples"]


def test_the_space_of_the_plate_counts(run_json, tmp_path, capture_stage) -> None:
    """Oracle: the same plate in ACEScg, said in its header or by flag."""
    wanted = graded_picture(capture_stage, **GRADE)
    acescg = wanted.copy()
    acescg[..., :3] = convert(wanted[..., :3], "lin_rec709_scene", "lin_ap1_scene")
    said = oiio.ImageBuf(np.ascontiguousarray(acescg))
    said.specmod().attribute("colorInteropID", "lin_ap1_scene")
    said.write(str(tmp_path / "said.exr"))
    silent = write(tmp_path / "silent.exr", acescg)
    for flags in (
        ("--reference", tmp_path / "said.exr"),
        ("--reference", silent, "--reference-space", "lin_ap1_scene"),
    ):
        report = run_json(
            "match", capture_stage, "-o", tmp_path / "graded.usda", *flags,
            "--fit", "exposure,whiteBalance",
        )  # fmt: skip
        assert report["temperature"] == pytest.approx(GRADE["temperature"], rel=2e-3)


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        ((), "match: found neither --reference nor --chart"),
        (("--chart", "classic24"), "match: found no --patches"),
        (("--reference", "nowhere.exr"), "nowhere.exr: found no such file, expected a picture"),
        (("--chart", "teapot", "--patches", "1,2,3,4"), "--chart: found 'teapot', expected one of"),
        (("--chart", "classic24", "--patches", "1,2,3,4"), "--patches: found 1 regions"),
        (
            ("--chart", "classic24", "--patches", ";".join(["0,0,1,1"] * 24)),
            "patch 'dark skin': found 0,0,1,1, where nothing is opaque",
        ),
        (
            ("--chart", "classic24", "--patches", ";".join(["0,0,1"] * 24)),
            "patch 'dark skin': found ['0', '0', '1'], expected x0,y0,x1,y1 in pixels",
        ),
        (("--reference", "PLATE", "--camera", "Nobody"), "--camera: found 'Nobody', expected one"),
        (
            ("--reference", "PLATE", "--prim", "/Nobody"),
            "--prim: found /Nobody, expected a visible",
        ),
        (("--reference", "PLATE", "--fit", "gamma"), "--fit: found 'gamma', expected one of"),
        (("--reference", "PLATE", "--reference-space", "x"), "expected one of lin_rec709_scene"),
        (("--reference", "PLATE", "--resolution", "9x9"), "--resolution: found a --reference"),
    ],
)
def test_a_mistake_is_one_sentence(run, tmp_path, capture_stage, plate, flags, sentence) -> None:
    """And nothing is written. Oracle: the sentence, and the folder."""
    words = [str(plate) if word == "PLATE" else word for word in flags]
    target = tmp_path / "graded.usda"
    status, out, err = run("match", capture_stage, "-o", target, *words)
    assert (status, out) == (2, "")
    assert sentence in err
    assert err.count("\n") == 1
    assert not target.exists()


def test_the_input_cannot_be_the_output(run, capture_stage, plate) -> None:
    """Oracle: the input's bytes."""
    before = capture_stage.read_bytes()
    status, _, err = run("match", capture_stage, "-o", capture_stage, "--reference", plate)
    assert status == 2
    assert "found a file that is being read" in err
    assert capture_stage.read_bytes() == before


def test_what_is_inside_an_instance_cannot_be_graded(run, tmp_path, capture_stage, plate) -> None:
    """Oracle: USD, which takes no opinions there."""
    root = tmp_path / "instanced.usda"
    stage = Usd.Stage.CreateNew(str(root))
    prim = stage.DefinePrim("/World")
    prim.GetReferences().AddReference(str(capture_stage))
    prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    status, _, err = run("match", root, "-o", tmp_path / "x.usda", "--reference", plate)
    assert status == 2
    assert "expected one that is visible and not inside an instance" in err
