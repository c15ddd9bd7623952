"""Tests of the findings on pictures of `usdsplat render`."""

from __future__ import annotations

import OpenImageIO as oiio
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade

from tests.cli.test_render import SMALL
from tests.delegate.surface_stages import add_material, add_mesh, bind
from tests.delegate.tree_stages import tree_stage
from usdsplat import procedural_capture, schema

pytestmark = pytest.mark.usefixtures("compiled")


def change(shot, edit):
    """Edit a stage file."""
    stage = Usd.Stage.Open(str(shot))
    edit(stage)
    stage.GetRootLayer().Save()


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (lambda s: s.RemovePrim("/World/Ball"), "a stage without splats, points or surfaces"),
        (
            lambda s: UsdGeom.Imageable(s.GetPrimAtPath("/World")).MakeInvisible(),
            "only splats that are hidden",
        ),
        (
            lambda s: (
                s.GetPrimAtPath("/World/Cam").GetAttribute("xformOp:translate").Set((0, 0, -9))
            ),
            "no splats in view",
        ),
    ],
)
def test_a_picture_of_nothing_says_why_once(run, shot, tmp_path, edit, why):
    """Oracle: the stage is changed so that nothing can be seen; status 0, one line for a
    sequence."""
    change(shot, edit)
    status, out, err = run("render", shot, "-o", tmp_path / "a.%d.png", *SMALL)
    assert (status, len(out.splitlines())) == (0, 4)
    assert err.startswith(f"usdsplat: error [nothing-to-draw] /World/Cam: found {why}")
    assert len(err.splitlines()) == 1


def test_a_broken_camera_matters_only_if_it_is_used(run, shot, tmp_path):
    """Oracle: a camera without aperture beside the good one: no word of it, or one error."""
    change(
        shot,
        lambda s: UsdGeom.Camera.Define(s, "/World/Odd").GetHorizontalApertureAttr().Set(0.0),
    )
    output = ("-o", tmp_path / "a.png", *SMALL)
    assert run("render", shot, *output, "--camera", "Cam")[::2] == (0, "")
    status, _, err = run("render", shot, *output, "--camera", "Odd")
    assert (status, len(err.splitlines())) == (2, 1)
    assert err.startswith("usdsplat: /World/Odd: found aperture 0 x ")


def test_shadows_of_a_stage_without_lights_are_a_finding(run, shot, tmp_path):
    """Oracle: one line with the code; none with a light, or without shadows."""
    output = ("-o", tmp_path / "a.exr", *SMALL)
    for flags in (("--aovs", "color,shadow"), ("--lighting", "shadowed")):
        status, _, err = run("render", shot, *output, *flags)
        assert status == 0 and err.count("[no-lights]") == 1
    assert "[no-lights]" not in run("render", shot, *output)[2]
    change(shot, lambda s: UsdLux.DistantLight.Define(s, "/World/Sun"))
    assert "[no-lights]" not in run("render", shot, *output, "--lighting", "shadowed")[2]


def test_a_relit_tree_has_the_notes_of_a_field(run, tmp_path):
    """Oracle: one line on its estimated light; none in shadows, or with a light that is named."""
    stage, _ = tree_stage(tmp_path)
    UsdLux.DistantLight.Define(stage, "/World/Sun")
    stage.Save()
    shot = tmp_path / "tree.usda"
    output = ("-o", tmp_path / "a.exr", *SMALL)
    assert run("render", shot, *output, "--lighting", "shadowed")[2] == ""
    status, _, err = run("render", shot, *output, "--lighting", "relit")
    assert status == 0 and err.count("[estimated-light] /World/Tree") == 1
    prim = stage.GetPrimAtPath("/World/Tree")
    prim.CreateRelationship("splat:lighting:captured").SetTargets(["/World/Sun"])
    stage.Save()
    assert run("render", shot, *output, "--lighting", "relit")[2] == ""


def test_a_light_of_photographs_inside_an_instance_is_a_finding(run, tmp_path):
    """Oracle: one line on two instances; none on one, or without relighting."""
    shot = tmp_path / "shot.usda"
    stage = Usd.Stage.CreateNew(str(shot))
    splats = schema.author(stage, "/Asset/Splats", procedural_capture(2000))
    for path in ("/Asset/Set", "/Sun"):
        UsdLux.DomeLight.Define(stage, path)
    names = splats.CreateRelationship("splat:lighting:captured", custom=False)
    names.SetTargets(["/Asset/Set"])
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for name in ("A", "B"):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim()
        prim.GetInherits().AddInherit("/Asset")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    output = ("-o", tmp_path / "a.exr", *SMALL)
    relit = (*output, "--lighting", "relit", "--dome-samples", "2")
    assert run("render", shot, *relit)[2].count("[instanced-light]") == 1
    assert "[instanced-light]" not in run("render", shot, *output)[2]
    change(shot, lambda s: s.GetPrimAtPath("/World/B").SetActive(False))
    assert "[instanced-light]" not in run("render", shot, *relit)[2]


def test_few_samples_of_a_wide_light_are_a_note(run, shot, tmp_path):
    """Oracle: 16 samples of 40 degrees, (40 / 5)² = 64 at 5 degrees; none where there are enough,
    where the light is dark or casts no shadows, or where the picture has none."""
    output = ("-o", tmp_path / "a.exr", *SMALL)
    change(shot, lambda s: UsdLux.DistantLight.Define(s, "/World/Sun").CreateAngleAttr(40.0))
    shadowed = (*output, "--lighting", "shadowed")
    status, _, err = run("render", shot, *shadowed, "--strict")
    assert status == 0 and err.count("note [few-light-samples] /World/Sun: ") == 1
    assert "found 16 samples, expected 64 or more for 40 degrees" in err
    assert "[few-light-samples]" not in run("render", shot, *output)[2]
    assert "[few-light-samples]" not in run("render", shot, *shadowed, "--light-samples", 64)[2]
    err = run("relight", shot, "-o", tmp_path / "relit.usdc")[2]
    assert err.count("[few-light-samples]") == 1

    def intensity(stage, value):
        UsdLux.DistantLight.Get(stage, "/World/Sun").CreateIntensityAttr().Set(value)

    change(shot, lambda s: intensity(s, 0.0))
    assert "[few-light-samples]" not in run("render", shot, *shadowed)[2]
    change(shot, lambda s: intensity(s, 1.0))

    def without_shadows(stage):
        prim = stage.GetPrimAtPath("/World/Sun")
        UsdLux.ShadowAPI.Apply(prim).CreateShadowEnableAttr(False)

    change(shot, without_shadows)
    assert "[few-light-samples]" not in run("render", shot, *shadowed)[2]


def test_findings_on_animated_lights_and_surfaces_are_said_once(run, shot, tmp_path):
    """Oracle: three frames of one light and of two materials, with other values in each: one line
    of each code, although the material that is named first is hidden in the last frame."""

    def animated(stage):
        sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
        for letter in "AB":
            mesh = add_mesh(stage, f"/World/{letter}", faces=1)
            bind(mesh, add_material(stage, f"/Looks/{letter}"))
            surface = UsdShade.Shader(stage.GetPrimAtPath(f"/Looks/{letter}/Surface"))
            rough = surface.CreateInput("roughness", Sdf.ValueTypeNames.Float)
            for frame in (1, 2, 3):
                rough.GetAttr().Set(0.1 * frame, frame)
        for frame in (1, 2, 3):
            sun.CreateIntensityAttr().Set(1e7 * frame, frame)
            sun.CreateAngleAttr().Set(40.0 + frame, frame)
        hidden = UsdGeom.Imageable.Get(stage, "/World/A").CreateVisibilityAttr()
        hidden.Set("inherited", 1)
        hidden.Set("invisible", 3)

    change(shot, animated)
    output = ("-o", tmp_path / "a.####.exr", *SMALL, "--frames", "1:3", "--jobs", 1)
    status, _, err = run("render", shot, *output, "--lighting", "shadowed")
    assert status == 0
    for code in ("extreme-light", "few-light-samples", "diffuse-surfaces"):
        assert err.count(f"[{code}]") == 1, err


def test_a_catcher_must_be_a_prim(run, shot, tmp_path):
    """Oracle: one sentence and status 2; the field is accepted, and is not in the picture."""
    output = ("-o", tmp_path / "a.exr", *SMALL, "--aovs", "color,shadow")
    status, _, err = run("render", shot, *output, "--catcher", "/World/Nothing")
    assert status == 2 and "--catcher" in err and "/World/Nothing" in err
    assert run("render", shot, *output, "--catcher", "/World/Ball")[0] == 0
    pixels = oiio.ImageBuf(str(tmp_path / "a.exr")).get_pixels(oiio.FLOAT)
    assert not pixels[..., :4].any() and (pixels[..., 4:] == 1).all()


def test_a_catcher_without_the_aov_of_its_shadow_is_a_note(run, shot, tmp_path):
    """Oracle: the code, in a picture without the AOV, and not in one with it."""
    flags = (*SMALL, "--catcher", "/World/Ball")
    for suffix, aovs, notes in (("png", "color", 1), ("exr", "color,shadow", 0)):
        status, _, err = run("render", shot, "-o", tmp_path / f"a.{suffix}", *flags, "--aovs", aovs)
        assert status == 0
        assert err.count("note [unused-catcher] /World/Ball: found") == notes, err


def test_a_collection_of_the_settings_relights_one_field(run, shot, tmp_path):
    """Oracle: the finding names that field alone; instances in two collections are a finding."""
    output = ("-o", tmp_path / "a.exr", *SMALL)

    def edit(stage):
        UsdLux.DistantLight.Define(stage, "/World/Sun")
        for name in ("One", "Two"):
            prim = stage.DefinePrim(f"/World/{name}")
            prim.GetReferences().AddInternalReference("/World/Ball")
        settings = UsdRender.Settings.Define(stage, "/Render/Settings")
        product = UsdRender.Product.Define(stage, "/Render/Product")
        settings.CreateProductsRel().SetTargets([product.GetPath()])
        relit = Usd.CollectionAPI.Apply(settings.GetPrim(), "lightRelit")
        relit.CreateIncludesRel().SetTargets(["/World/One"])

    change(shot, edit)
    err = run("render", shot, *output)[2]
    assert err.count("[estimated-light]") == err.count("[estimated-light] /World/One") == 1

    def instance(stage):
        for name in ("One", "Two"):
            prim = stage.GetPrimAtPath(f"/World/{name}")
            prim.GetReferences().SetReferences([Sdf.Reference(primPath="/Source")])
            prim.SetInstanceable(True)
        stage.DefinePrim("/Source/Splats").GetReferences().AddInternalReference("/World/Ball")

    change(shot, instance)
    err = run("render", shot, *output)[2]
    assert err.count("[split-lighting]") == 1 and "captured and relit" in err
