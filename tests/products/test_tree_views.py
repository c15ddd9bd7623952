"""Tests of the views for which splat trees are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Gf, Usd, UsdGeom, UsdRender

from tests.delegate.stages import add_camera, random_cloud
from tests.delegate.tree_stages import tree_stage
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.exporting import export_stage
from usdsplat.interchange.options import StageReading
from usdsplat.products import summary
from usdsplat.products.tree_views import MOST_VIEWS, ViewRequest, choice_of, view_of
from usdsplat.render.lod.nodes import view_cut


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    """A tree, three point instances of it at different distances, a native instance, a field and
    two cameras."""
    stage, _ = tree_stage(tmp_path)
    near, far = add_camera(stage, "/Near", eye=(0, 0, 4)), add_camera(stage, "/Far")
    for frame, z in ((0, 4), (9, 40)):
        near.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(0, 0, z), frame)
    far.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(0, 0, 400))
    many = UsdGeom.PointInstancer.Define(stage, "/Many")
    proto = stage.DefinePrim("/Many/Tree")
    proto.GetReferences().AddInternalReference("/World/Tree")
    many.CreatePrototypesRel().SetTargets(["/Many/Tree"])
    many.CreateProtoIndicesAttr([0, 0, 0])
    many.CreatePositionsAttr([(1, 0, -3), (0, 0, -60), (0, 0, 50)])
    for name, x in (("A", 0.5), ("B", -30)):
        copy = stage.DefinePrim(f"/{name}", "Xform")
        copy.GetReferences().AddInternalReference("/World")
        copy.SetInstanceable(True)
        UsdGeom.Xformable(copy).AddTranslateOp().Set((x, 0, -5))
    schema.author(stage, "/Field", random_cloud(3, n=50))
    return stage


@pytest.mark.parametrize(
    ("camera", "settings"),
    [
        ("/Near", {"lod_error": 0.0}),
        ("Near", {"lod_error": 1.0}),
        ("/Near", {"lod_error": 0.0, "splat_budget": 1500}),
        ("/Near", {"lod_error": 0.0, "splat_budget": 900}),
        ("/Far", {"lod_error": 3.0}),
    ],
)
def test_a_capture_has_the_cut_of_a_picture(
    stage: Usd.Stage, tmp_path: Path, camera: str, settings: dict[str, float]
) -> None:
    """Oracle: the nodes that the renderer chooses for each instance, and the field."""
    request = ViewRequest(camera=camera, resolution=(160, 120), settings=settings)
    choice, time = choice_of(stage, request, None)
    report = export_stage(stage, tmp_path / "near.ply", StageReading(time=time, trees=choice))
    expected = 50
    with Engine(stage, time=None) as engine:
        view, how = view_of(engine, request)
        cut = view_cut(engine.render_scene, view, how)
        for (_, tree), reached in zip(engine.render_scene.drawn_trees(), cut.trees, strict=True):
            table, drawn = tree.spec.table, reached.above_error(cut.limit)
            expected += int(table.residents[drawn.nodes].sum())
            expected += int(table.proxies[drawn.nodes[~drawn.refined]].sum())
    assert report.splats == expected


def test_the_product_with_the_camera_gives_resolution_and_settings(stage: Usd.Stage) -> None:
    """Oracle: the values that are authored; the first product for another camera."""
    for name, camera, size in (("A", "/Far", (64, 48)), ("B", "/Near", (320, 240))):
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.CreateCameraRel().SetTargets([camera])
        product.CreateResolutionAttr(Gf.Vec2i(*size))
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateProductsRel().SetTargets(["/Render/A", "/Render/B"])
    add_camera(stage, "/Third")
    with Engine(stage) as engine:
        for camera, size in (("/Near", (320, 240)), ("/Far", (64, 48)), ("/Third", (64, 48))):
            view, _ = view_of(engine, ViewRequest(camera=camera))
            assert (view.camera.path, view.framing.resolution) == (camera, size)
        view, how = view_of(
            engine, ViewRequest(camera="Near", resolution=(9, 8), settings={"lod_error": 7.0})
        )
        assert (view.framing.resolution, how.lod_error) == ((9, 8), 7.0)


def test_the_first_frame_is_the_default(stage: Usd.Stage) -> None:
    """Oracle: the position that is authored at the frame, and USD's default value without a
    range."""
    request = ViewRequest(camera="/Near")
    assert choice_of(stage, request, None)[1] is None
    stage.SetStartTimeCode(9)
    stage.SetEndTimeCode(12)
    for given in (None, 9.0):
        choice, time = choice_of(stage, request, given)
        assert choice.view is not None and time == 9
        assert choice.view.view.camera.world_to_camera[11] == -40


def test_what_is_not_there_is_one_sentence(stage: Usd.Stage, tmp_path: Path) -> None:
    """Oracle: the contract of errors."""
    with pytest.raises(StageError, match="--camera: found 'Other', expected one of /Far, /Near"):
        choice_of(stage, ViewRequest(camera="Other"), None)
    with pytest.raises(UsageError, match="expected at most 65536 pixels on a side"):
        choice_of(stage, ViewRequest(camera="Near", resolution=(99999, 9)), None)
    choice, _ = choice_of(stage, ViewRequest(camera="Near"), None)
    for path in ("/World", "/A", "/B", "/Many"):
        stage.GetPrimAtPath(path).SetActive(False)
    with pytest.raises(UsageError, match="found a stage without splat trees"):
        export_stage(stage, tmp_path / "a.ply", StageReading(trees=choice))


def test_every_camera_is_described_by_what_its_picture_loads(stage: Usd.Stage) -> None:
    """Oracle: the memory of the renderer after the picture of each camera; one that frames
    everything without cameras."""
    found = summary.of_stage(stage, None, view=ViewRequest(settings={"lod_error": 2.0}))
    assert [each["camera"] for each in found["views"]] == ["/Far", "/Near"]
    for told in found["views"]:
        assert (told["resolution"], told["lod_error"], told["frame"]) == ([1920, 1080], 2.0, None)
        with Engine(stage, device="cpu", time=None) as engine:
            view, how = view_of(engine, ViewRequest(camera=told["camera"]))
            for _ in engine.render(view, replace(how, lod_error=2.0)):
                pass
            assert engine.render_scene.node_cache.bytes == told["bytes"] > 0
            cut = view_cut(engine.render_scene, view, replace(how, lod_error=2.0))
            assert cut.splats == told["splats"]
    for path in ("/Near", "/Far"):
        stage.GetPrimAtPath(path).SetActive(False)
    (told,) = summary.of_stage(stage, None)["views"]
    assert (told["camera"], told["frames_everything"], told["lod_error"]) == (None, True, 1.0)
    assert told["splats"] > 0


def test_views_are_at_the_first_frame_and_not_too_many(stage: Usd.Stage) -> None:
    """Oracle: the numbers that were authored; a camera that cannot be used has its problem."""
    stage.SetStartTimeCode(9)
    stage.SetEndTimeCode(12)
    for number in range(MOST_VIEWS):
        add_camera(stage, f"/A{number:02}", eye=(0, 0, 99))
    stage.GetPrimAtPath("/A00").GetAttribute("focalLength").Set(float("nan"))
    found = summary.of_stage(stage, None)
    assert (len(found["views"]), found["views_left_out"]) == (MOST_VIEWS, 2)
    assert "problem" in found["views"][0] and found["views"][1]["frame"] == 9
    near = summary.of_stage(stage, None, view=ViewRequest(camera="Near"))
    (early,) = near["views"]
    assert (early["camera"], near["views_left_out"]) == ("/Near", None)
    (late,) = summary.of_stage(stage, 0.0, view=ViewRequest(camera="Near"))["views"]
    assert early["splats"] < late["splats"]


def test_a_view_of_a_stage_without_trees_is_one_sentence() -> None:
    """Oracle: the contract of errors; without a request there is nothing to say."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Field", random_cloud(3, n=5))
    assert "views" not in summary.of_stage(stage, None)
    with pytest.raises(UsageError, match="found a stage without splat trees"):
        summary.of_stage(stage, None, view=ViewRequest(settings={"lod_error": 2.0}))
