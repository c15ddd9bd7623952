"""Tests of pages as files."""

from __future__ import annotations

import json
import shutil
import zipfile
from io import BytesIO

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender

from tests.delegate.stages import random_cloud, two_fields
from tests.products.page.pages import moving_stage, parsed, still_stage
from tests.sim.stage.scenes import LIVELY, save_shot
from tests.sim.stage.stages import SIM
from usdsplat import convert, export_capture, formats, schema
from usdsplat.core.edits import parsed as edit_of
from usdsplat.core.errors import (
    FormatError,
    OutputError,
    StageError,
    UnknownFormatError,
    UsageError,
)
from usdsplat.core.output import output_group
from usdsplat.interchange.files import is_page
from usdsplat.interchange.lod import LodOptions, build_tree
from usdsplat.interchange.options import ExportOptions, ImportOptions
from usdsplat.products.page import PageRequest, write_page, writing
from usdsplat.products.page.document import VIEWER, VIEWER_FILES
from usdsplat.sim.stage.simulating import SimulateOptions, simulate


@pytest.fixture
def shot(tmp_path):
    """A stage with a moving camera, as a file."""
    path = tmp_path / "shot.usda"
    moving_stage().Export(str(path))
    return path


def test_a_page_holds_the_sog_that_the_stage_exports_to(shot, tmp_path):
    """Oracle: the bytes of the exported file."""
    report = write_page(shot, tmp_path / "page.html")
    export_capture(shot, tmp_path / "still.sog", time=1.0)
    page = parsed(tmp_path / "page.html")
    assert page.capture == (tmp_path / "still.sog").read_bytes()
    assert (page.title, page.data["capture"], page.data["url"]) == ("shot", "scene.sog", "")
    assert (report.splats, report.camera, len(report.frames)) == (300, "/Camera", 12)
    assert report.files == (str(tmp_path / "page.html"),)
    assert report.bytes == (tmp_path / "page.html").stat().st_size


def test_the_aspect_ratio_is_that_of_the_picture(shot, tmp_path):
    """Oracle: the resolution."""
    write_page(shot, tmp_path / "a.html", request=PageRequest(resolution=(300, 200)))
    assert parsed(tmp_path / "a.html").data["aspect"] == 1.5


def test_a_capture_is_upright_and_edited(tmp_path):
    """Oracle: axes given as rub, so that its y is up and the page's SOG has it down; an edit."""
    cloud = random_cloud(3, n=50)
    formats.write(cloud, tmp_path / "scan.ply")
    target = tmp_path / "page.html"
    write_page(
        tmp_path / "scan.ply",
        target,
        edits=(edit_of("translate", "0,5,0"),),
        options=ImportOptions(axes="rub"),
    )
    (tmp_path / "out.sog").write_bytes(parsed(target).capture)
    found = formats.read(tmp_path / "out.sog").cloud.positions
    assert found[:, 1].mean() == pytest.approx(-5 - cloud.positions[:, 1].mean(), abs=1e-3)


def test_several_captures_are_in_one_page(tmp_path):
    """Oracle: the sum of their splats."""
    for k in (1, 2):
        formats.write(random_cloud(k, n=10 * k), tmp_path / f"{k}.ply")
    report = write_page([tmp_path / "1.ply", tmp_path / "2.ply"], tmp_path / "page.html")
    assert report.splats == 30


def test_antialiased_splats_are_drawn_so(tmp_path):
    """Oracle: the file's flag, which the page passes to the viewer."""
    how = formats.WriteOptions(antialiased=True)
    for name, options in (("a", how), ("b", formats.WriteOptions())):
        formats.write(random_cloud(1), tmp_path / f"{name}.sog", how=options)
        write_page(tmp_path / f"{name}.sog", tmp_path / f"{name}.html")
    made = [parsed(tmp_path / f"{name}.html").data["antialiased"] for name in "ab"]
    assert made == [True, False]


def test_a_folder_has_the_viewer_and_the_capture_beside_the_page(shot, tmp_path):
    """Oracle: the files, and those of the viewer."""
    target = tmp_path / "web" / "index.html"
    report = write_page(shot, target)
    names = {"index.html", "scene.sog", *(f"viewer/{name}" for name in VIEWER_FILES)}
    found = {str(path.relative_to(target.parent)) for path in map(type(target), report.files)}
    assert found == names
    assert report.bytes == sum(target.parent.joinpath(name).stat().st_size for name in names)
    for name in VIEWER_FILES:
        assert target.parent.joinpath("viewer", name).read_bytes() == (VIEWER / name).read_bytes()
    export_capture(shot, tmp_path / "still.sog", time=1.0)
    assert (target.parent / "scene.sog").read_bytes() == (tmp_path / "still.sog").read_bytes()
    assert any("browsers do not read files beside a page" in note for note in report.notes)


def test_a_folder_in_a_group_of_outputs_is_reported_whole(shot, tmp_path):
    """Oracle: the report without a group; the files come at the end of the group."""
    alone = write_page(shot, tmp_path / "a" / "index.html")
    with output_group():
        grouped = write_page(shot, tmp_path / "b" / "index.html")
        assert not (tmp_path / "b" / "index.html").exists()
    assert (tmp_path / "b" / "index.html").exists()
    assert (len(grouped.files), grouped.bytes) == (len(alone.files), alone.bytes)


def test_a_splat_tree_is_streamed_from_a_folder(tmp_path):
    """Oracle: the levels of the streamed SOG; and one level in one file."""
    formats.write(random_cloud(2, n=4000), tmp_path / "scan.ply")
    build_tree(tmp_path / "scan.ply", tmp_path / "tree.usda", options=LodOptions(leaf_splats=500))
    report = write_page(tmp_path / "tree.usda", tmp_path / "web" / "index.html")
    data = parsed(tmp_path / "web" / "index.html").data
    assert (data["capture"], data["url"]) == ("lod-meta.json", "scene/lod-meta.json")
    meta = json.loads((tmp_path / "web" / "scene" / "lod-meta.json").read_text())
    assert meta["lodLevels"] > 1
    assert report.splats == 4000
    write_page(tmp_path / "tree.usda", tmp_path / "page.html")
    with zipfile.ZipFile(BytesIO(parsed(tmp_path / "page.html").capture)) as archive:
        assert json.loads(archive.read("meta.json"))["count"] == 4000


def test_moving_splats_and_surfaces_are_noted(tmp_path):
    """Oracle: the stage: a field of two that moves, a cube; a still one has neither note."""
    stage = still_stage()
    assert write_page(stage, tmp_path / "a.html").notes == ()
    stage.SetStartTimeCode(3)
    stage.SetEndTimeCode(4)
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/World/A")).AddTranslateOp()
    for frame in (3, 4):
        move.Set((frame, 0, 0), frame)
    UsdGeom.Cube.Define(stage, "/World/Cube")
    notes = write_page(stage, tmp_path / "b.html").notes
    assert notes == (
        "the page shows frame 3: the animation of 1 field is not in it",
        "the page has only splats, without 1 surface",
    )
    notes = write_page(stage, tmp_path / "c.html", export=ExportOptions(time=4.0)).notes
    assert "frame 4" in notes[0]


def test_lights_are_noted(tmp_path):
    """Oracle: their number by hand: a sun, a lamp, and a mesh that shines."""
    stage = still_stage()
    UsdLux.DistantLight.Define(stage, "/Sun")
    UsdLux.RectLight.Define(stage, "/Lamp")
    assert write_page(stage, tmp_path / "a.html").notes == (
        "the page has the captured light, without 2 lights",
    )
    UsdLux.MeshLightAPI.Apply(UsdGeom.Mesh.Define(stage, "/Neon").GetPrim())
    assert write_page(stage, tmp_path / "b.html").notes == (
        "the page has only splats, without 1 surface",
        "the page has the captured light, without 3 lights",
    )


def test_lighting_that_the_stage_asks_for_is_a_finding(tmp_path):
    """Oracle: the settings of the first product, and a collection of them; not those of others."""
    stage = still_stage()
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    paths = [f"/Render/{name}" for name in ("First", "Second")]
    first, second = (UsdRender.Product.Define(stage, path).GetPrim() for path in paths)
    settings.CreateProductsRel().SetTargets(paths)
    token = Sdf.ValueTypeNames.Token
    second.CreateAttribute("splat:lighting", token).Set("relit")
    assert write_page(stage, tmp_path / "a.html").findings == ()
    first.CreateAttribute("splat:lighting", token).Set("shadowed")
    (found,) = write_page(stage, tmp_path / "b.html").findings
    assert (found.code, found.path) == ("not-applied", "/Render/First")
    assert found.found == "shadowed lighting"
    first.GetAttribute("splat:lighting").Set("captured")
    members = Usd.CollectionAPI.Apply(first, "lightRelit")
    members.CreateIncludesRel().SetTargets(["/World/A"])
    (found,) = write_page(stage, tmp_path / "c.html").findings
    assert found.found == "relit lighting" and "usdsplat relight" in found.cure


def test_lighting_is_read_with_the_resolution_and_the_camera_of_the_page(tmp_path, run):
    """Oracle: a product without a resolution or a camera of its own is complete with those of the
    command, which ends with status 0 and the finding."""
    stage = still_stage()
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateResolutionAttr(Gf.Vec2i(0, 0))
    settings.GetPrim().CreateAttribute("splat:lighting", Sdf.ValueTypeNames.Token).Set("relit")
    product = UsdRender.Product.Define(stage, "/Render/First")
    settings.CreateProductsRel().SetTargets(["/Render/First"])
    product.CreateCameraRel().SetTargets(["/Nowhere"])
    stage.Export(str(shot := tmp_path / "shot.usda"))
    page = tmp_path / "page.html"
    asked = ("--resolution", "64x64", "--camera", "/Camera")
    status, _, err = run("convert", shot, page, *asked)
    assert (status, page.exists()) == (0, True), err
    assert err.count("warning [not-applied] /Render/First: found relit lighting") == 1


def test_a_simulation_is_noted_until_it_is_baked(tmp_path):
    """Oracle: the stage: with its simulation alone, and with the bake over it."""
    shot = save_shot(tmp_path, LIVELY)
    found = [each for each in write_page(shot, tmp_path / "a.html").notes if "simulation" in each]
    assert len(found) == 1 and f"simulation {SIM}, which is not baked" in found[0]
    bake = tmp_path / "baked" / "bake.usda"
    bake.parent.mkdir()
    simulate(Usd.Stage.Open(str(shot)), bake, (1.0, 2.0), SimulateOptions())
    notes = write_page(bake, tmp_path / "b.html").notes
    assert not [each for each in notes if "simulation" in each]


@pytest.mark.parametrize(
    ("names", "title"),
    [
        (("a/x.ply", "b/y.ply"), "x + y"),
        (("hall/lod-meta.json",), "hall"),
        (("hall/meta.json", "a/x.ply"), "hall + x"),
    ],
)
def test_the_title_is_the_name_of_what_is_shown(tmp_path, names, title):
    """Oracle: the names by hand."""
    formats.write(random_cloud(1, n=900), tmp_path / "scan.ply")
    tree, how = tmp_path / "tree.usda", LodOptions(leaf_splats=300)
    build_tree(tmp_path / "scan.ply", tree, options=how)
    for name in names:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        source = tree if path.name == "lod-meta.json" else tmp_path / "scan.ply"
        convert(source, path)
    write_page([tmp_path / name for name in names], tmp_path / "page.html")
    assert parsed(tmp_path / "page.html").title == title


def test_a_stage_in_memory_makes_the_same_bytes_each_time(tmp_path):
    """Oracle: another stage with the same content, in another layer."""
    for name in ("a.html", "b.html"):
        write_page(still_stage(), tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert parsed(tmp_path / "a.html").title == "capture"


def test_missing_folders_are_made(shot, tmp_path):
    """Oracle: the files; on an error the folders are removed again."""
    for target in (tmp_path / "a" / "b" / "index.html", tmp_path / "c" / "d" / "page.html"):
        write_page(shot, target)
        assert target.is_file()
    with pytest.raises(StageError):
        write_page(Usd.Stage.CreateInMemory(), tmp_path / "e" / "f" / "index.html")
    assert not (tmp_path / "e").exists()


@pytest.mark.parametrize("name", ["f.txt/index.html", "f.txt/a/index.html", "f.txt/page.html"])
def test_a_file_in_place_of_the_folder_is_one_sentence(shot, tmp_path, name):
    """Oracle: the class of the error, and its words."""
    (tmp_path / "f.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"found a file, .*f\.txt, expected a place"):
        write_page(shot, tmp_path / name)


def test_a_large_page_is_noted(shot, tmp_path, monkeypatch):
    """Oracle: a limit below its size."""
    monkeypatch.setattr(writing, "LARGE", 1_000_000)
    report = write_page(shot, tmp_path / "page.html")
    assert "MiB in one file opens slowly: index.html in a folder" in report.notes[-1]


def test_a_folder_with_other_files_stays_as_it_is(shot, tmp_path):
    """Oracle: the message and the files."""
    folder = tmp_path / "web"
    folder.mkdir()
    (folder / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="a folder with other files"):
        write_page(shot, folder / "index.html")
    assert [path.name for path in folder.iterdir()] == ["mine.txt"]


def test_a_page_that_fails_leaves_nothing(tmp_path):
    """Oracle: the folder before and after; an older page stays."""
    stage = Usd.Stage.CreateInMemory()
    (tmp_path / "page.html").write_text("older")
    for target in (tmp_path / "page.html", tmp_path / "web" / "index.html"):
        with pytest.raises(StageError):
            write_page(stage, target)
    assert {path.name for path in tmp_path.iterdir()} == {"page.html"}
    assert (tmp_path / "page.html").read_text() == "older"


def test_what_cannot_be_a_page_is_one_sentence(shot, tmp_path):
    """Oracle: the class of the error, and its words."""
    (tmp_path / "bad.ply").write_text("ply")
    formats.write(random_cloud(), tmp_path / "a.ply")
    with pytest.raises(UnknownFormatError, match=r"expected \.html"):
        write_page(shot, tmp_path / "page.htm")
    with pytest.raises(FormatError):
        write_page(tmp_path / "bad.ply", tmp_path / "page.html")
    with pytest.raises(UsageError, match="a stage among several inputs, expected only captures"):
        write_page([shot, tmp_path / "a.ply"], tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()
    assert [is_page(name) for name in ("a.html", "A.HTML", "html", "a.htm")] == [1, 1, 0, 0]


def test_only_the_named_prim_is_in_the_page(tmp_path):
    """Oracle: one cloud of two."""
    options = ImportOptions(prim_path="/World/B")
    report = write_page(two_fields(), tmp_path / "page.html", options=options)
    assert (report.splats, report.prim_paths) == (12, ("/World/B",))


def test_a_capture_with_harmonics_of_degree_four_loses_the_last(tmp_path):
    """Oracle: the degree that SOG can hold, and a note."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/A", random_cloud(1, degree=4))
    report = write_page(stage, tmp_path / "page.html")
    assert report.degree == 3
    assert "harmonics above degree 3" in report.notes[0]


def test_a_page_does_not_replace_its_source(tmp_path):
    """Oracle: the file, whose content is a capture, stays."""
    path = tmp_path / "scan.html"
    formats.write(random_cloud(), tmp_path / "scan.ply")
    shutil.copy(tmp_path / "scan.ply", path)
    with pytest.raises(OutputError, match="a file that is being read"):
        write_page(path, path)
    assert path.read_bytes() == (tmp_path / "scan.ply").read_bytes()
