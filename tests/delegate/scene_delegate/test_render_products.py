"""Tests of UsdRender prims. Oracle: the rules of its documentation, applied by hand."""

from __future__ import annotations

import pytest
from pxr import Gf, Sdf, Usd, UsdRender

from tests.delegate.stages import two_fields
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate.render_names import AOVS
from usdsplat.images.aovs import AOVS as FILE_AOVS
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing


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
    assert (plain.path, plain.names) == ("/Render/Plain", ())
    assert plain.camera == "/Main"
    assert plain.kind == "raster"
    assert plain.framing == Framing(
        resolution=(200, 100), data_window=(0, 0, 100, 100), pixel_aspect_ratio=2.0,
        conform="cropAperture",
    )  # fmt: skip
    assert plain.settings == RenderSettings(sorting="zDepth", sh_degree=1)
    assert plain.aovs == ("color",)
    assert plain.purposes == own.purposes == ("default", "guide")
    assert (own.path, own.camera) == ("/Render/Own", "/Witness")
    assert own.names == ((1.0, "first.exr"), (2.0, "second.exr"))
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
    ],
)
def test_prims_that_cannot_be_used_are_refused_in_a_sentence(stage, spoil, words):
    """Oracle: the sentence."""
    spoil(stage)
    with Engine(stage) as engine, pytest.raises(StageError, match=words):
        engine.products()


def test_vars_of_other_renderers_are_left_out_and_said(stage):
    """Oracle: the sentence, and the product as it is without the var."""
    with Engine(stage) as engine:
        before = {product.path: product.aovs for product in engine.products()}
        UsdRender.Var(stage.GetPrimAtPath("/Render/depth")).GetSourceNameAttr().Set("lpe:C<RD>L")
        changed = [product for product in engine.products() if product.findings]
        assert changed
        for product in changed:
            assert "depth" in before[product.path] and "depth" not in product.aovs
            (found,) = product.findings
            assert found.message.startswith(
                "/Render/depth.sourceName: found 'lpe:C<RD>L', expected one"
            )


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
    assert (product.names, product.camera, product.aovs) == (
        ((0.0, "primary.exr"),),
        "/main_cam",
        ("color",),
    )
    assert view.framing == Framing(resolution=(512, 512))
    assert view.camera.window[2] == pytest.approx(0.5 * 20.955 / 25.0)


@pytest.mark.parametrize(
    ("name", "knob"),
    [
        ("disableMotionBlur", "motion_blur"),
        ("instantaneousShutter", "motion_blur"),
        ("disableDepthOfField", "depth_of_field"),
    ],
)
def test_what_is_disabled_is_off_unless_the_product_says_otherwise(stage, name, knob):
    """Oracle: UsdRender's documentation; the product's opinion wins, the caller's above all."""
    settings, own = (stage.GetPrimAtPath(f"/Render/{each}") for each in ("Settings", "Own"))
    settings.GetAttribute(name).Set(True)
    own.GetAttribute(name).Set(False)
    with Engine(stage) as engine:
        assert [getattr(each.settings, knob) for each in engine.products()] == [False, True]
        own.CreateAttribute(f"splat:{_camel(knob)}", Sdf.ValueTypeNames.Bool).Set(False)
        assert [getattr(each.settings, knob) for each in engine.products()] == [False, False]
        forced = engine.products(overrides={knob: True})
        assert [getattr(each.settings, knob) for each in forced] == [True, True]


def _camel(name):
    first, *rest = name.split("_")
    return first + "".join(word.capitalize() for word in rest)


def test_deep_products_and_parts_are_asked_for_by_product(stage):
    """Oracle: the authored values."""
    own = stage.GetPrimAtPath("/Render/Own")
    UsdRender.Product(own).CreateProductTypeAttr("deepRaster")
    own.CreateAttribute("splat:multipart", Sdf.ValueTypeNames.Bool).Set(True)
    with Engine(stage) as engine:
        plain, deep = engine.products()
    assert (plain.kind, plain.multipart) == ("raster", False)
    assert (deep.kind, deep.multipart) == ("deepRaster", True)


@pytest.mark.parametrize(
    ("beauty", "alpha", "depth", "expected"),
    [
        (None, None, None, {}),
        (None, None, "half", {"depth": "half"}),
        ("color3h", None, None, {"color": "half"}),
        ("half3", "half", "float", {"color": "half", "alpha": "half", "depth": "float"}),
        ("color4h", "float", None, {"color": "half", "alpha": "float"}),
        ("color3f", None, None, {"color": "float"}),
        ("color3d", None, None, {"color": "float"}),
    ],
)
def test_channels_have_the_precision_their_vars_ask_for(stage, beauty, alpha, depth, expected):
    """Oracle: the list above; a type that nobody authors is no wish."""
    for name, value in (("beauty", beauty), ("alpha", alpha), ("depth", depth)):
        if value:
            var = UsdRender.Var(stage.GetPrimAtPath(f"/Render/{name}"))
            var.CreateDataTypeAttr(value)
    with Engine(stage) as engine:
        _, own = engine.products()
    assert dict(own.pixel_types) == expected


def test_solaris_states_the_type_of_the_file_apart_from_that_of_the_data(stage):
    """Oracle: the attribute that Solaris' Render Var authors beside dataType."""
    var = UsdRender.Var(stage.GetPrimAtPath("/Render/beauty"))
    var.CreateDataTypeAttr("color4f")
    name = "driver:parameters:aov:format"
    var.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.Token).Set("color4h")
    with Engine(stage) as engine:
        _, own = engine.products()
    assert dict(own.pixel_types) == {"color": "half"}


def test_a_product_adds_entries_to_headers_as_for_husk(stage):
    """Oracle: the values authored here; the names that Solaris gives them, and what is refused."""
    own, kinds = stage.GetPrimAtPath("/Render/Own"), Sdf.ValueTypeNames
    for name, kind, value in (
        ("artist", kinds.String, "Ada"),
        ("comment", kinds.String, ""),
        ("aov:name", kinds.String, "no entry"),
        ("OpenEXR:show", kinds.String, "abc"),
        ("OpenEXR:take", kinds.Int, 7),
        ("OpenEXR:gain", kinds.Float3, (1, 2, 3)),
        ("OpenEXR:final", kinds.Bool, True),
        ("OpenEXR:isoSpeed", kinds.Int, 800),
        ("OpenEXR:compression", kinds.String, "piz"),
        ("OpenEXR:dataWindow", kinds.String, "lies"),
    ):
        own.CreateAttribute(f"driver:parameters:{name}", kind).Set(value)
    with Engine(stage) as engine:
        _, product = engine.products()
        assert dict(product.metadata) == {
            "artist": "Ada", "show": "abc", "take": 7, "gain": (1.0, 2.0, 3.0), "final": 1,
            "isoSpeed": 800.0,
        }  # fmt: skip
        assert product.settings.compression == "piz"
        (found,) = (each for each in product.findings if each.code == "product-metadata")
        assert found.attribute == "driver:parameters:OpenEXR:dataWindow"
        own.GetAttribute("driver:parameters:OpenEXR:compression").Set("pxr24")
        _, product = engine.products()
    assert product.settings.compression == ""
    assert "'pxr24'" in [each.found for each in product.findings]


def test_channels_that_would_have_another_name_are_a_note(stage):
    """Oracle: the name authored here, which Solaris gives each var."""
    var = next(prim for prim in stage.Traverse() if prim.IsA(UsdRender.Var))
    name = "driver:parameters:aov:name"
    var.CreateAttribute(name, Sdf.ValueTypeNames.String).Set("mine")
    with Engine(stage) as engine:
        found = [each for product in engine.products() for each in product.findings]
    named = [each for each in found if each.code == "unsupported-name"]
    assert named
    assert {(each.path, each.attribute, each.severity) for each in named} == {
        (str(var.GetPath()), name, "note")
    }


def held_out(product, path):
    """What `View.matte` says rules mean."""
    above = [rule for rule in product.matte if Sdf.Path(path).HasPrefix(Sdf.Path(rule[0]))]
    return max(above, key=lambda rule: len(rule[0]))[1] if above else False


@pytest.mark.parametrize("rule", ["expandPrims", "explicitOnly"])
@pytest.mark.parametrize("root", [False, True])
def test_mattes_are_what_usd_says_a_collection_holds(stage, rule, root):
    """Oracle: USD's own query, prim by prim: excludes, a nested collection, and the root."""
    for path in ("/World/A/Leaf", "/World/A/Leaf/Vein", "/Set/Wall", "/Set/Floor", "/Far"):
        stage.DefinePrim(path, "Sphere")
    nested = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/Set"), "hard")
    nested.CreateIncludesRel().SetTargets(["/Set"])
    nested.CreateExcludesRel().SetTargets(["/Set/Floor"])
    settings = stage.GetPrimAtPath("/Render/Settings")
    matte = Usd.CollectionAPI.Apply(settings, "matte")
    matte.CreateExpansionRuleAttr(rule)
    matte.CreateIncludeRootAttr(root)
    matte.CreateIncludesRel().SetTargets(["/World/A", "/World/A/Leaf/Vein", "/Set.collection:hard"])
    matte.CreateExcludesRel().SetTargets(["/World/A/Leaf"])
    query = matte.ComputeMembershipQuery()
    with Engine(stage) as engine:
        plain, own = engine.products()
    for prim in stage.Traverse():
        path = prim.GetPath()
        assert held_out(plain, path) == held_out(own, path) == query.IsPathIncluded(path), path
    assert len(plain.matte) == len(set(dict(plain.matte)))


def test_mattes_may_be_expressions_and_reach_into_instances(stage):
    """Oracle: the names of the prims."""
    stage.DefinePrim("/Source/WallOne", "Sphere")
    instance = stage.DefinePrim("/Instance")
    instance.GetReferences().AddInternalReference("/Source")
    instance.SetInstanceable(True)
    own = stage.GetPrimAtPath("/Render/Own")
    matte = Usd.CollectionAPI.Apply(own, "matte")
    matte.CreateMembershipExpressionAttr(Sdf.PathExpression("//Wall*"))
    with Engine(stage) as engine:
        plain, cut = engine.products()
    assert plain.matte == ()
    assert cut.matte == (("/Instance/WallOne", True), ("/Source/WallOne", True))


def test_collections_of_light_are_read_and_a_product_has_its_own(stage):
    """Oracle: the collections authored here, in the order captured, shadowed, relit."""
    settings, own = (stage.GetPrimAtPath(f"/Render/{name}") for name in ("Settings", "Own"))
    for prim, name, target in (
        (settings, "lightRelit", "/World/A"),
        (settings, "lightCaptured", "/World/B"),
        (own, "lightRelit", "/World/B"),
    ):
        stage.DefinePrim(target, "Sphere")
        Usd.CollectionAPI.Apply(prim, name).CreateIncludesRel().SetTargets([target])
    with Engine(stage) as engine:
        plain, cut = engine.products()
    captured = ("captured", (("/World/B", True),))
    assert plain.light_rules == (captured, ("relit", (("/World/A", True),)))
    assert cut.light_rules == (captured, ("relit", (("/World/B", True),)))


def test_a_pass_brings_its_mattes_when_it_is_the_only_one_or_is_named(stage):
    """Oracle: the collections authored here; passes of the same settings are alternatives."""
    for name, target in (("One", "/World/A"), ("Two", "/World/B")):
        each = UsdRender.Pass.Define(stage, f"/Render/{name}")
        each.CreateRenderSourceRel().SetTargets(["/Render/Settings"])
        each.GetPrim().GetRelationship("collection:matte:includes").SetTargets([target])
        with Engine(stage) as engine:
            assert engine.products(f"/Render/{name}")[0].matte == ((target, True),)
            expected = ((target, True),) if name == "One" else ()
            assert engine.products()[0].matte == expected
            assert engine.products()[0].findings == ()
    with Engine(stage) as engine:
        each.CreateRenderSourceRel().ClearTargets(True)
        with pytest.raises(StageError, match="renderSource: found none"):
            engine.products("/Render/Two")


@pytest.mark.parametrize("name", ["prune", "renderVisibility", "cameraVisibility"])
def test_collections_of_a_pass_that_change_nothing_here_are_said(stage, name):
    """Oracle: the sentence."""
    each = UsdRender.Pass.Define(stage, "/Render/Pass")
    each.CreateRenderSourceRel().SetTargets(["/Render/Settings"])
    part = "includes" if name == "prune" else "excludes"
    each.GetPrim().GetRelationship(f"collection:{name}:{part}").SetTargets(["/World/A"])
    with Engine(stage) as engine:
        (found,) = engine.products()[0].findings
    assert found.message.startswith(f"/Render/Pass.collection:{name}: found some prims, expected")


def test_options_of_other_writers_are_honoured_or_said(stage):
    """Oracle: the attributes authored here; scanlines and one part are what is written anyway."""
    own, kinds = stage.GetPrimAtPath("/Render/Own"), Sdf.ValueTypeNames
    for name, kind, value in (
        ("OpenEXR:storage", kinds.String, "scanline"),
        ("OpenEXR:multipart", kinds.Bool, True),
        ("ocio", kinds.String, "ACEScg"),
    ):
        own.CreateAttribute(f"driver:parameters:{name}", kind).Set(value)
    with Engine(stage) as engine:
        plain, product = engine.products()
        assert (plain.settings.multipart, product.settings.multipart) == (False, True)
        assert [each.attribute for each in product.findings] == ["driver:parameters:ocio"]
        own.GetAttribute("driver:parameters:OpenEXR:storage").Set("tiled")
        _, product = engine.products()
        assert ("'tiled'", "splat:tileSize for tiles") in {
            (each.found, each.expected) for each in product.findings
        }


@pytest.mark.parametrize(
    ("name", "space"),
    [
        ("lin_ap1_scene", "lin_ap1_scene"), ("ACEScg", "lin_ap1_scene"),
        ("acescg", "lin_ap1_scene"), ("Linear Rec.2020", "lin_rec2020_scene"),
        ("raw", ""), ("nonsense", ""),
    ],
)  # fmt: skip
def test_the_rendering_space_of_settings_is_the_working_space(stage, name, space):
    """Oracle: the OCIO names of the ACES configs; splat:workingSpace on the product goes first."""
    settings = UsdRender.Settings(stage.GetPrimAtPath("/Render/Settings"))
    settings.CreateRenderingColorSpaceAttr(name)
    own = stage.GetPrimAtPath("/Render/Own")
    own.CreateAttribute("splat:workingSpace", Sdf.ValueTypeNames.Token).Set("lin_p3d65_scene")
    with Engine(stage) as engine:
        plain, product = engine.products()
    assert plain.settings.working_space == (space or RenderSettings().working_space)
    assert product.settings.working_space == "lin_p3d65_scene"
    said = [each.found for each in plain.findings if each.code == "rendering-space"]
    assert said == ([] if space else [repr(name)])


def test_a_light_path_of_all_light_is_the_beauty(stage):
    """Oracle: the expression that Karma's settings author for the beauty, and its depth."""
    for name, source in (("beauty", "C.*[LO]"), ("depth", "ray:hitPz"), ("who", "C<RD>.*[LO]")):
        UsdRender.Var(stage.GetPrimAtPath(f"/Render/{name}")).GetSourceNameAttr().Set(source)
    with Engine(stage) as engine:
        _, own = engine.products()
    assert own.aovs == ("color", "depth")
    assert [each.found for each in own.findings if each.code == "unknown-var"] == ["'C<RD>.*[LO]'"]
