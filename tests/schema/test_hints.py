"""Tests of colour spaces and rendering hints."""

from __future__ import annotations

import pytest
from pxr import Gf, Sdf, Usd

from tests.schema.clouds import cloud, stock_prim, three_points
from usdsplat import schema
from usdsplat.core.errors import UsageError
from usdsplat.schema import hints, tokens


def test_a_field_that_names_no_space_is_srgb(stage: Usd.Stage) -> None:
    """Oracle: the project's declared default, a name that Gf knows."""
    prim = stock_prim(stage, {"positions": three_points()})
    assert schema.color_space(prim) == "srgb_rec709_scene"
    assert hints.written_color_space(prim) == ""
    assert Gf.ColorSpace.IsValid(schema.color_space(prim))


def test_authoring_names_the_space_where_usd_finds_it(stage: Usd.Stage) -> None:
    """Oracle: USD's ColorSpaceAPI."""
    prim = schema.author(stage, "/Splats", cloud(), color_space="lin_rec709_scene")
    attribute = prim.GetAttribute(tokens.SH_COEFFICIENTS)
    found = Usd.ColorSpaceAPI.ComputeColorSpaceName(attribute, None)
    assert found == "lin_rec709_scene"
    assert schema.color_space(prim) == "lin_rec709_scene"


def test_authoring_again_keeps_the_space(stage: Usd.Stage) -> None:
    """Oracle: what was asked for first."""
    schema.author(stage, "/Splats", cloud(), color_space="lin_rec709_scene")
    prim = schema.author(stage, "/Splats", cloud())
    assert schema.color_space(prim) == "lin_rec709_scene"


def test_the_nearest_opinion_counts(stage: Usd.Stage) -> None:
    """Oracle: USD's own resolution: attribute, prim, ancestors."""
    parent = stage.DefinePrim("/World", "Xform")
    Usd.ColorSpaceAPI.Apply(parent).CreateColorSpaceNameAttr("lin_ap1_scene")
    prim = stage.DefinePrim("/World/Splats", tokens.STOCK_TYPE)
    attribute = prim.GetAttribute(tokens.SH_COEFFICIENTS)

    def usd() -> str:
        return Usd.ColorSpaceAPI.ComputeColorSpaceName(attribute, None)

    assert schema.color_space(prim) == usd() == "lin_ap1_scene"
    Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr("lin_rec709_scene")
    assert schema.color_space(prim) == usd() == "lin_rec709_scene"
    attribute.SetColorSpace("srgb_ap1_scene")
    assert schema.color_space(prim) == usd() == "srgb_ap1_scene"


def test_a_space_of_the_parent_is_not_repeated_on_the_field(stage: Usd.Stage) -> None:
    """Oracle: the prim's own opinions."""
    parent = stage.DefinePrim("/World", "Xform")
    Usd.ColorSpaceAPI.Apply(parent).CreateColorSpaceNameAttr("lin_ap1_scene")
    prim = schema.author(stage, "/World/Splats", cloud())
    assert not prim.HasAttribute(tokens.COLOR_SPACE)


def test_the_display_name_is_an_alias_that_gf_never_sees(stage: Usd.Stage, capfd) -> None:
    """Oracle: the name for the same numbers; Gf would warn about the other on stderr."""
    prim = stage.DefinePrim("/Splats", tokens.STOCK_TYPE)
    Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr("srgb_rec709_display")
    assert schema.color_space(prim) == "srgb_rec709_scene"
    written = schema.author(stage, "/Other", cloud(), color_space="srgb_rec709_display")
    assert written.GetAttribute(tokens.COLOR_SPACE).Get() == "srgb_rec709_scene"
    assert capfd.readouterr().err == ""


def test_a_name_nobody_knows_is_returned_as_it_is(stage: Usd.Stage) -> None:
    """Oracle: the authored token."""
    prim = stage.DefinePrim("/Splats", tokens.STOCK_TYPE)
    Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr("house_space")
    assert schema.color_space(prim) == "house_space"


@pytest.mark.parametrize("form", ["float", "packed"])
def test_modes_are_written_and_read(stage: Usd.Stage, form: str) -> None:
    """Oracle: the values that were asked for; authoring without them keeps them."""
    modes = {
        "rasterize_mode": "antialiased",
        "projection_mode": "tangential",
        "sorting_mode": "rayHitDistance",
        "footprint": 0.25,
    }
    schema.author(stage, "/Splats", cloud(1), form=form, drawing=schema.DrawingHints(**modes))
    prim = schema.author(stage, "/Splats", cloud(2), form=form)
    for name, value in modes.items():
        assert getattr(schema, name)(prim) == value
    assert not prim.GetAttribute("projectionModeHint").IsCustom()
    assert prim.HasAPI("SplatFieldAPI")


def test_modes_that_are_missing_or_unknown_are_the_first(stage: Usd.Stage) -> None:
    """Oracle: the schema's fallbacks."""
    prim = stage.DefinePrim("/Splats", tokens.STOCK_TYPE)
    prim.GetAttribute("sortingModeHint").Set("sideways")
    assert schema.sorting_mode(prim) == "zDepth"
    assert schema.projection_mode(prim) == "perspective"
    assert schema.rasterize_mode(prim) == "classic"
    assert schema.footprint(prim) is None


@pytest.mark.parametrize("size", [0.0, -1.0, float("nan"), float("inf")])
def test_a_footprint_that_is_no_size_is_not_used(stage: Usd.Stage, size: float) -> None:
    """Oracle: the documented range."""
    prim = stage.DefinePrim("/Splats", tokens.STOCK_TYPE)
    prim.CreateAttribute(tokens.FOOTPRINT, Sdf.ValueTypeNames.Float).Set(size)
    assert schema.footprint(prim) is None
    with pytest.raises(UsageError, match=r"footprint: found .*, expected a finite number above 0"):
        schema.DrawingHints(footprint=size)
