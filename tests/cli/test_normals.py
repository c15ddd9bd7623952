"""Tests of `usdsplat normals`, from the command line to the layer."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.cli.test_main import shell
from tests.kernels.points.splat_shapes import sphere
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud

pytestmark = pytest.mark.usefixtures("compiled")

FIELD = "/World/Ball"


def shell_of_splats(count=800, rows=None):
    """A sphere, and its normals."""
    shape = sphere(count)
    rows = np.arange(count) if rows is None else rows
    positions, rotations, scales, opacities = (array[rows] for array in shape.splats)
    colors = np.zeros((len(rows), 1, 3), np.float32)
    cloud = SplatCloud(
        positions=positions, rotations=rotations, scales=scales, opacities=opacities, sh=colors
    )
    return cloud, shape.normals[rows]


@pytest.fixture
def scan(tmp_path):
    """A stage with a sphere of splats; Z is up."""
    path = tmp_path / "in" / "scan.usda"
    path.parent.mkdir()
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    stage.Save()
    return path


def field(path, *, form="float", where=FIELD, time=None, rows=None):
    """Add a sphere to a stage; return its normals."""
    stage = Usd.Stage.Open(str(path))
    cloud, normals = shell_of_splats(rows=rows)
    schema.author(stage, where, cloud, form=form, time=time)
    stage.Save()
    return normals


def surface(path, where=FIELD, time=None):
    """The primvars of a field."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath(where)
    return schema.fetch_surface(prim, len(schema.fetch(prim, time)), time)


def mean_error(found, normals):
    """The mean angle between normals [degree]."""
    cosines = np.einsum("ij,ij->i", found, normals)
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean()


@pytest.mark.parametrize("form", ["float", "half", "packed"])
def test_the_layer_has_a_normal_for_each_splat_in_the_order_of_the_field(
    run_json, scan, tmp_path, form
) -> None:
    """Oracle: closed form of a sphere; its splats are shuffled."""
    rows = np.random.default_rng(3).permutation(800)
    normals = field(scan, form=form, rows=rows)
    before, target = scan.read_bytes(), tmp_path / "normals.usda"
    report = run_json("normals", scan, "-o", target)
    assert scan.read_bytes() == before
    assert [each["path"] for each in report["fields"]] == [FIELD]
    assert report["fields"][0]["splats"] == 800
    found = surface(target)
    assert mean_error(found.normals, normals) < 4
    assert np.median(found.confidence) == pytest.approx(report["fields"][0]["confidence"], abs=1e-3)
    assert found.occlusion.max() < 0.2


def test_the_primvars_are_those_that_others_read(run, scan, tmp_path) -> None:
    """Oracle: UsdGeom's own PrimvarsAPI, and the specs of the layer: overs only, which name the
    stage by a relative path."""
    field(scan)
    target = tmp_path / "normals.usdc"
    status, out, _ = run("normals", scan, "-o", target)
    assert status == 0
    assert out.startswith(f"{target}: normals of 1 field\n  {FIELD}: 800 splats, confidence 0.")
    layer = Sdf.Layer.FindOrOpen(str(target))
    assert list(layer.subLayerPaths) == ["./in/scan.usda"]
    assert layer.GetPrimAtPath(FIELD).specifier == Sdf.SpecifierOver
    assert not layer.GetPrimAtPath(FIELD).typeName
    stage = Usd.Stage.Open(layer)
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FIELD))
    for name, kind in (
        ("normals", Sdf.ValueTypeNames.Normal3hArray),
        ("splat:confidence", Sdf.ValueTypeNames.HalfArray),
        ("splat:occlusion", Sdf.ValueTypeNames.HalfArray),
    ):
        primvar = api.GetPrimvar(name)
        assert primvar.GetTypeName() == kind
        assert primvar.GetInterpolation() == UsdGeom.Tokens.vertex
        assert len(primvar.Get()) == 800


def test_each_sample_of_a_field_has_its_normals(run_json, scan, tmp_path) -> None:
    """Oracle: closed form of a sphere whose count changes."""
    rows = np.random.default_rng(1).permutation(800)
    normals = {1: field(scan, time=1), 5: field(scan, time=5, rows=rows[100:])}
    target = tmp_path / "normals.usda"
    report = run_json("normals", scan, "-o", target)
    assert report["fields"][0]["samples"] == 2
    for time, expected in normals.items():
        assert mean_error(surface(target, time=time).normals, expected) < 10
    stage = Usd.Stage.Open(str(target))
    attribute = stage.GetPrimAtPath(FIELD).GetAttribute("primvars:normals")
    assert attribute.GetTimeSamples() == [1, 5]


def test_only_the_chosen_fields_get_normals(run_json, run, scan, tmp_path) -> None:
    """Oracle: the prims of the layer; a path without a field is an error that lists the fields."""
    field(scan), field(scan, where="/World/Group/Other")
    target = tmp_path / "normals.usda"
    report = run_json("normals", scan, "-o", target, "--prim", "/World/Group")
    assert [each["path"] for each in report["fields"]] == ["/World/Group/Other"]
    assert not Sdf.Layer.FindOrOpen(str(target)).GetPrimAtPath(FIELD)
    other = tmp_path / "other.usda"
    status, _, err = run("normals", scan, "-o", other, "--prim", "/World/Grou")
    assert status == 2
    assert err == (
        "usdsplat: --prim: found /World/Grou, expected a field: /World/Ball, /World/Group/Other\n"
    )
    assert not other.exists()


def test_a_field_in_an_instance_is_a_finding(run, scan, tmp_path) -> None:
    """Oracle: the rule that no opinion can be authored there; a strict command writes nothing."""
    field(scan), field(scan, where="/Proto/Ball")
    stage = Usd.Stage.Open(str(scan))
    instance = stage.DefinePrim("/World/Copy", "Xform")
    instance.GetReferences().AddInternalReference("/Proto")
    instance.SetInstanceable(True)
    stage.Save()
    target = tmp_path / "normals.usda"
    status, out, err = run("normals", scan, "-o", target, "--json")
    assert status == 0
    assert err == (
        "usdsplat: warning [no-normals] /World/Copy/Ball: found a field in an instance, expected "
        "one that a layer can change\n"
    )
    report = json.loads(out)
    assert [each["code"] for each in report["findings"]] == ["no-normals"]
    assert {each["path"] for each in report["fields"]} == {FIELD, "/Proto/Ball"}
    strict = tmp_path / "strict.usda"
    assert run("normals", scan, "-o", strict, "--strict")[0] == 1
    assert not strict.exists()


def test_normals_are_in_the_space_of_the_field(run, scan, tmp_path) -> None:
    """Oracle: the same field without the transform, bit for bit."""
    field(scan)
    first, second = tmp_path / "first.usda", tmp_path / "second.usda"
    assert run("normals", scan, "-o", first)[0] == 0
    stage = Usd.Stage.Open(str(scan))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTransformOp().Set(
        Gf.Matrix4d().SetRotate(Gf.Rotation((1, 2, 3), 70))
    )
    stage.Save()
    assert run("normals", scan, "-o", second)[0] == 0
    np.testing.assert_array_equal(surface(first).normals, surface(second).normals)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("SCAN", "-o", "OUT/n.usdz"), "found OUT/n.usdz, expected a .usda, .usdc or .usd layer"),
        (("SCAN", "-o", "OUT/n.ply"), "found suffix '.ply', expected one of .usd .usda"),
        (("SCAN", "-o", "SCAN"), "found a file that is being read, expected another name"),
        (("CAPTURE", "-o", "OUT/n.usda"), "found a capture, expected a USD file; usdsplat convert"),
        (("EMPTY", "-o", "OUT/n.usda"), "fields: found none that a layer can change (no field"),
        (("OUT/no.usda", "-o", "OUT/n.usda"), "found no such file, expected a USD file"),
    ],
)
def test_wrong_files_are_one_sentence(run, scan, capture, tmp_path, words, sentence) -> None:
    """Oracle: the sentence; the status is 2, and nothing is written."""
    empty = tmp_path / "empty.usda"
    empty.write_bytes(scan.read_bytes())
    field(scan)
    before = scan.read_bytes()
    places = {"SCAN": scan, "CAPTURE": capture, "EMPTY": empty, "OUT": tmp_path}

    def told(text):
        for name, path in places.items():
            text = text.replace(name, str(path))
        return text

    status, out, err = run("normals", *map(told, words))
    assert (status, out) == (2, "")
    assert told(sentence) in err
    assert err.count("\n") == 1
    assert scan.read_bytes() == before
    assert not list(tmp_path.glob("n.*"))


def test_a_process_of_its_own_prints_nothing_else(scan, tmp_path) -> None:
    """Oracle: the lines."""
    field(scan)
    target = tmp_path / "normals.usda"
    done = shell("normals", scan, "-o", target, "--threads", "1", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) == 2


def test_the_fields_that_stand_for_a_tree_get_no_normals(run, run_json, scan, capture, tmp_path):
    """Oracle: the prims of the layer, and the finding on the tree, which lights give normals."""
    field(scan)
    tree, target = tmp_path / "t.usda", tmp_path / "normals.usda"
    assert run("lod", capture, "-o", tree, "--up-axis", "Z", "-q")[0] == 0
    stage = Usd.Stage.Open(str(scan))
    stage.DefinePrim("/World/T").GetReferences().AddReference(str(tree))
    stage.Save()
    report = run_json("normals", scan, "-o", target, "-q")
    assert [each["path"] for each in report["fields"]] == [FIELD]
    found = [(each["code"], each["path"]) for each in report["findings"]]
    assert found == [("no-normals", "/World/T/splats")]
    status, _, err = run("normals", tree, "-o", target, "-q")
    assert status == 2 and err.startswith("usdsplat: fields: found splat trees only (/t/splats), ")
