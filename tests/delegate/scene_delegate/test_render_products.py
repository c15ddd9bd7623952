"""UsdRender prims, against the rules of its documentation worked out by hand."""

from __future__ import annotations

import pytest
from pxr import Gf, Sdf, Usd, UsdRender

from tests.delegate.stages import two_fields
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.scene_delegate.render_products import AOVS
from usdsplat.delegate.specs import Framing
from usdsplat.images.aovs import AOVS as FILE_AOVS


@pytest.fixture
def stage():
    """Settings with two products: one that says nothing, one that overrides everything."""
    stage = two_fields()
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateResolutionAttr(Gf.Vec2i(200, 100))
    settings.CreatePixelAspectRatioAttr(2.0)
    settings.CreateAspectRatioConformPolicyAttr("cropAperture")
    settings.CreateDataWindowNDCAttr(Gf.Vec4f(0, 0, 0.5, 1))
    settings.CreateIncludedPurposesAttr(["default", "guide"])
    settings.CreateCameraRel().SetTargets(["/Main"])
    settings.GetPrim().CreateAttribute("splat:sorting", Sdf.ValueTypeNames.Token).Set("zDepth")
    settings.GetPrim().CreateAttribute("splat:shDegree", Sdf.ValueTypeNames.Int).Set(1)
    settings.CreateProductsRel().SetTargets(["/Render/Plain", "/Render/Own"])
    UsdRender.Product.Define(stage, "/Render/Plain")
    own = UsdRender.Product.Define(stage, "/Render/Own")
    own.CreateProductNameAttr().Set("first.exr", 1)
    own.CreateProductNameAttr().Set("second.exr", 2)
    own.CreateResolutionAttr(Gf.Vec2i(40, 30))
    own.CreatePixelAspectRatioAttr(1.0)
    own.CreateAspectRatioConformPolicyAttr("expandAperture")
    own.CreateDataWindowNDCAttr(Gf.Vec4f(-0.5, 0, 1, 1))
    own.CreateCameraRel().SetTargets(["/Witness"])
    own.GetPrim().CreateAttribute("splat:sorting", Sdf.ValueTypeNames.Token).Set("cameraDistance")
    for name, source in (("beauty", "Ci"), ("depth", "z"), ("alpha", "a"), ("who", "id")):
        UsdRender.Var.Define(stage, f"/Render/{name}").CreateSourceNameAttr(source)
    own.CreateOrderedVarsRel().SetTargets(
        [f"/Render/{name}" for name in ("beauty", "depth", "alpha", "who")]
    )
    return stage


def test_products_inherit_what_they_do_not_say(stage):
    """Oracle: UsdRender's documentation: settings first, then what the product authors."""
    with Engine(stage, time=2) as engine:
        plain, own = engine.products()
    assert (plain.path, plain.name) == ("/Render/Plain", "")
    assert plain.camera == "/Main"
    assert plain.kind == "raster"
    assert plain.framing == Framing(
        resolution=(200, 100), data_window=(0, 0, 100, 100), pixel_aspect_ratio=2.0,
        conform="cropAperture",
    )  # fmt: skip
    assert plain.settings == RenderSettings(sorting="zDepth", sh_degree=1)
    assert plain.aovs == ("color",)
    assert plain.purposes == own.purposes == ("default", "guide")
    assert (own.path, own.name, own.camera) == ("/Render/Own", "second.exr", "/Witness")
    assert own.framing == Framing(resolution=(40, 30), data_window=(-20, 0, 40, 30))
    assert own.settings == RenderSettings(sorting="cameraDistance", sh_degree=1)
    assert own.aovs == ("color", "depth", "primId")


def test_the_caller_has_the_last_word(stage):
    """Oracle: the arguments; the data window is cut again at the new resolution."""
    with Engine(stage) as engine:
        plain, own = engine.products(
            camera="/Mine", resolution=(400, 300), overrides={"sorting": "auto", "sh_degree": 0}
        )
    assert plain.camera == own.camera == "/Mine"
    assert plain.framing.resolution == own.framing.resolution == (400, 300)
    assert plain.framing.data_window == (0, 0, 200, 300)
    assert plain.settings == own.settings == RenderSettings(sh_degree=0)


def test_a_stage_names_its_settings_or_has_a_first_one_or_none(stage):
    """Oracle: the stage's own metadata."""
    other = UsdRender.Settings.Define(stage, "/Render/Other")
    with Engine(stage) as engine:
        assert len(engine.products()) == 2
        stage.SetMetadata("renderSettingsPrimPath", "/Render/Other")
        assert engine.products() == ()
        assert len(engine.products("/Render/Settings")) == 2
        other.CreateProductsRel().SetTargets(["/Render/Own"])
        (own,) = engine.products()
    assert own.framing.resolution == (40, 30)
    with Engine(Usd.Stage.CreateInMemory()) as engine:
        assert engine.products() == ()


def test_blocked_values_are_the_schemas(stage):
    """Oracle: UsdRender's documented fallbacks."""
    settings = stage.GetPrimAtPath("/Render/Settings")
    for name in ("resolution", "includedPurposes", "dataWindowNDC"):
        settings.GetAttribute(name).Block()
    with Engine(stage) as engine:
        plain, _ = engine.products()
    assert plain.framing.resolution == (2048, 1080)
    assert plain.framing.data_window is None
    assert plain.purposes == ("default", "render")


def test_every_aov_of_a_file_can_be_asked_for_by_its_names():
    """Oracle: the table of what files hold, in both of its spellings."""
    for aov in FILE_AOVS.values():
        assert AOVS[aov.name] == AOVS[aov.hydra] == aov.hydra


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda s: s.GetPrimAtPath("/Render/depth").SetTypeName("Scope"), "a RenderVar prim"),
        (lambda s: s.RemovePrim("/Render/Plain"), "a RenderProduct prim"),
        (
            lambda s: UsdRender.Var(s.GetPrimAtPath("/Render/depth")).GetSourceNameAttr().Set("Ng"),
            "sourceName: found 'Ng', expected one of",
        ),
    ],
)
def test_prims_that_cannot_be_used_are_refused_in_a_sentence(stage, spoil, words):
    """Oracle: the sentence."""
    spoil(stage)
    with Engine(stage) as engine, pytest.raises(StageError, match=words):
        engine.products()


def test_unknown_settings_and_values_are_refused_in_a_sentence(stage):
    """Oracle: the sentence."""
    with Engine(stage) as engine:
        for path in ("/Render/Own", "/nowhere", "Settings"):
            with pytest.raises(StageError, match="the path of a RenderSettings prim"):
                engine.products(path)
        with pytest.raises(UsageError, match="sh_degree: found 9, expected 0 to 4"):
            engine.products(overrides={"sh_degree": 9})
        stage.GetAttributeAtPath("/Render/Own.splat:sorting").Set("random")
        with pytest.raises(UsageError, match="/Render/Own sorting: found 'random'"):
            engine.products()


def test_pixars_render_settings_are_understood(data):
    """Oracle: the text of OpenUSD's own example stage."""
    stage = Usd.Stage.Open(str(data / "usd" / "openusd" / "renderSettingsEdits.usda"))
    with Engine(stage) as engine:
        (product,) = engine.products()
        view = engine.view(product.camera, framing=product.framing)
    assert (product.name, product.camera, product.aovs) == ("primary.exr", "/main_cam", ("color",))
    assert view.framing == Framing(resolution=(512, 512))
    assert view.camera.window[2] == pytest.approx(0.5 * 20.955 / 25.0)
