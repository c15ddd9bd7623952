"""Tests of the rows of a prim's properties, metadata and composition."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLux, Vt

from tests.delegate.stages import random_cloud
from tests.preview.stage_model.stages import add_attributes, rich, spinning, value_types
from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.properties import (
    composition,
    matching,
    metadata,
    properties,
)


def rows(stage, path, **options):
    return {(each.kind, each.name): each for each in properties(stage, path, **options)}


def texts(stage, path, **options):
    return {each.name: each.text for each in properties(stage, path, **options)}


def test_where_a_value_comes_from():
    """Oracle: the stage as it was made: fallback, default, samples, and an edit of a user's."""
    stage = spinning()
    stage.GetAttributeAtPath("/Group/Ball.radius").Set(2.5)
    found = rows(stage, "/Group/Ball", time=5.5)
    place = found["attribute", "xformOp:translate"]
    assert (place.source, place.samples, place.text) == ("time samples", 2, "(0, 5.5, 0)")
    radius = found["attribute", "radius"]
    assert (radius.source, radius.text, radius.samples) == ("default", "2.5", 0)
    assert radius.layer and not radius.is_edited
    assert found["attribute", "visibility"].source == "fallback"
    Edits(stage).set_value("/Group/Ball.radius", 4.0)
    edited = rows(stage, "/Group/Ball")["attribute", "radius"]
    assert edited.is_edited and edited.text == "4" and "session" in edited.layer


def test_samples_are_shown_at_the_default_time_too():
    """Oracle: the first sample, which is what is drawn then."""
    found = rows(spinning(), "/Group/Ball")["attribute", "xformOp:translate"]
    assert (found.text, found.source) == ("(0, 1, 0)", "time samples")


def test_values_of_clips_say_so(tmp_path):
    """Oracle: a stage whose samples are in another file, by the clips API."""
    clip = Usd.Stage.CreateNew(str(tmp_path / "clip.usda"))
    clip.DefinePrim("/A").CreateAttribute("x", Sdf.ValueTypeNames.Double).Set(7.0, 1.0)
    clip.GetRootLayer().Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    prim = stage.DefinePrim("/A")
    prim.CreateAttribute("x", Sdf.ValueTypeNames.Double)
    api = Usd.ClipsAPI(prim)
    api.SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])
    api.SetClipPrimPath("/A")
    api.SetClipActive([(1, 0)])
    api.SetClipTimes([(1, 1)])
    api.SetClipManifestAssetPath("./clip.usda")
    found = rows(stage, "/A", time=1.0)["attribute", "x"]
    assert (found.source, found.text) == ("value clips", "7")


def test_arrays_are_abbreviated_and_splats_counted():
    """Oracle: the cloud's own numbers; packed and half fields say so."""
    stage = Usd.Stage.CreateInMemory()
    cloud = random_cloud(3, n=1500, degree=2)
    for form in ("float", "half", "packed"):
        schema.author(stage, f"/{form}", cloud, form=form)
        found = texts(stage, f"/{form}")
        assert found["Splats"] == "1,500" and found["SH degree"] == "2"
        assert found["Form"].split(",")[0] == form
    text = texts(stage, "/float")["positions"]
    first = ", ".join(f"{part:.7g}" for part in cloud.positions[0].tolist())
    assert text.startswith(f"1,500 × [({first}), (") and text.endswith(", …]") and len(text) < 200


def test_a_million_numbers_are_never_formatted():
    """Oracle: as many elements are asked for as are shown, counted by the array itself."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/A")
    numbers = Vt.Vec3fArray.FromNumpy(np.zeros((1_000_000, 3), np.float32))
    prim.CreateAttribute("p", Sdf.ValueTypeNames.Point3fArray).Set(numbers)
    prim.SetCustomDataByKey("long", "x" * 100_000)
    text = texts(stage, "/A")["p"]
    assert text == "1,000,000 × [(0, 0, 0), (0, 0, 0), (0, 0, 0), …]"
    (custom,) = [each for each in metadata(stage, "/A") if each.name == "customData"]
    assert len(custom.text) < 250


def test_rows_are_computed_as_usdview_has_them():
    """Oracle: the box and the place of a unit ball at (1, 2, 3), by hand."""
    stage = rich()
    found = texts(stage, "/World/Ball")
    assert found["World bounding box"] == "(0, 1, 2) to (2, 3, 4)"
    assert found["Local to world"].endswith("(1, 2, 3, 1))")
    UsdGeom.Imageable(stage.GetPrimAtPath("/World")).MakeInvisible()
    assert texts(stage, "/World/Ball")["Visibility, inherited"] == "invisible"


def test_every_type_of_value_is_a_row_and_its_editor_can_be_json():
    """Oracle: one row for each attribute; strict JSON; editors where values are simple."""
    stage = rich()
    add_attributes(stage)
    found = rows(stage, "/World/All", time=1.0)
    assert len([each for each in found if each[0] == "attribute"]) == len(value_types())
    for each in found.values():
        json.dumps(asdict(each), allow_nan=False)
    with_editor = {each.type_name for each in found.values() if each.editor}
    assert {"bool", "token", "color3f", "double4", "uint64", "asset"} <= with_editor
    assert not any("[]" in name or name.startswith(("quat", "matrix")) for name in with_editor)


def test_editors_hold_what_is_said_and_are_taken_back():
    """Oracle: setting each editor's value changes nothing that the rows show."""
    stage = rich()
    for path in ("/World/Ball", "/World/Camera", "/World/Cloud", "/World/Sim"):
        before = texts(stage, path)
        edits = Edits(stage)
        for each in properties(stage, path):
            if each.editor and each.source != "none":
                edits.set_value(f"{path}.{each.name}", each.editor.value)
        assert texts(stage, path) == before


def test_parameters_have_the_limits_of_their_knobs():
    """Oracle: the range that the parameter declares."""
    editor = rows(rich(), "/World/Sim")["attribute", "splatSim:rd:feed"].editor
    assert (editor.minimum, editor.maximum) == (0.0, 0.1) and "feed rate" in editor.help.lower()
    life = rows(rich(), "/World/Sim")["attribute", "splatSim:growth:life"].editor
    assert life.value is None and life.none_label == "unlimited"


def test_connections_and_relationships_are_rows():
    """Oracle: what was connected and related."""
    stage = rich()
    ball = stage.GetPrimAtPath("/World/Ball")
    ball.GetAttribute("radius").AddConnection("/World/Sim.out")
    ball.CreateRelationship("friend").SetTargets(["/World/Cloud"])
    found = rows(stage, "/World/Ball")
    assert found["connection", "radius"].text == "[/World/Sim.out]"
    assert found["attribute", "radius"].text == "1"
    friend = found["relationship", "friend"]
    assert friend.text == "[/World/Cloud]" and friend.source == "default" and friend.is_custom


def test_what_is_in_an_instance_is_shown_and_not_edited():
    """Oracle: no editor, for the session layer can say nothing there."""
    found = rows(rich(), "/World/Instance/Cube")
    assert found["attribute", "size"].text == "2"
    assert all(each.editor is None for each in found.values())


@pytest.mark.parametrize("path", ["/", "/World/Over", "/_class", "/World/Instance", "/World/Sim"])
def test_every_sort_of_prim_has_rows(path):
    """Oracle: none of them raises, an inactive one neither; metadata is in order."""
    stage = rich()
    names = [each.name for each in metadata(stage, path)]
    assert names == sorted(names) and composition(stage, path)
    properties(stage, path)
    if path != "/":
        stage.GetPrimAtPath(path).SetActive(False)
        properties(stage, path)
        assert {"active": "False"}.items() <= {
            each.name: each.text for each in metadata(stage, path)
        }.items()


def test_applied_schemas_are_a_list():
    """Oracle: the schemas that the stage was made with."""
    found = {each.name: each.text for each in metadata(rich(), "/World/Sim")}
    assert found["apiSchemas"] == "SplatSimGrowthAPI, SplatDeformerAPI:bend"
    assert found["typeName"] == "SplatSim"


def test_composition_lists_opinions_the_strongest_first():
    """Oracle: the session's edit, the prim, its variant; and a reference."""
    stage = rich()
    Edits(stage).set_purpose("/World/Part", "proxy")
    part = [each for each in composition(stage, "/World/Part") if each.has_specs]
    assert [each.kind for each in part] == ["root", "root", "variant"]
    assert "session" in part[0].layer and part[2].path == "/World/Part{season=summer}"
    kinds = [(each.kind, each.path) for each in composition(stage, "/World/Instance")]
    assert ("reference", "/_class") in kinds


@pytest.mark.parametrize("path", ["", "World", "/None", "/World/Ball.radius", "\0"])
def test_what_is_no_prim_is_a_sentence(path):
    """Oracle: the shape of all our errors."""
    for ask in (properties, metadata, composition):
        with pytest.raises(StageError, match=r"found .+, expected .+"):
            ask(rich(), path)


@pytest.mark.parametrize(
    ("light", "first"),
    [
        (UsdLux.DistantLight, ["intensity", "exposure", "color", "angle"]),
        (UsdLux.SphereLight, ["intensity", "exposure", "color", "radius"]),
        (UsdLux.DomeLight, ["intensity", "exposure", "color", "texture:file"]),
        (UsdLux.RectLight, ["intensity", "exposure", "color", "texture:file", "width", "height"]),
    ],
)
def test_what_people_turn_of_a_light_comes_first_and_collections_last(light, first):
    """Oracle: the order of the words of the lights' schemas, by hand; no row is lost."""
    stage = Usd.Stage.CreateInMemory()
    prim = light.Define(stage, "/Light").GetPrim()
    names = [each.name for each in properties(stage, "/Light")]
    assert names[: len(first)] == [f"inputs:{name}" for name in first]
    inputs = [name.startswith("inputs:") for name in names]
    assert inputs == sorted(inputs, reverse=True)
    collections = [name.startswith("collection:") for name in names]
    assert any(collections) and collections == sorted(collections)
    assert {each.GetName() for each in prim.GetProperties()} < set(names)


def test_a_search_has_the_words_of_that_of_prims():
    """Oracle: by hand: parts of names, types and values, and patterns of whole ones."""
    stage = Usd.Stage.CreateInMemory()
    UsdLux.DomeLight.Define(stage, "/Sky").CreateTextureFileAttr(Sdf.AssetPath("Street.exr"))
    found = properties(stage, "/Sky")

    def names(text):
        return [each.name for each in matching(found, text)]

    assert names("INTENS") == ["inputs:intensity"]
    assert names(" street ") == ["inputs:texture:file"]
    assert names("color3f") == ["inputs:color"]
    assert names("inputs:*file") == ["inputs:texture:file"]
    assert names("intensity?") == []
    assert len(names("")) == len(found)
