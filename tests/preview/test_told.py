"""Tests of what is said beside a picture."""

from __future__ import annotations

from dataclasses import replace

from pxr import Sdf, UsdShade

from tests.delegate.surface_stages import add_material, add_mesh, bind
from tests.preview.documents import STATE, drawn_by
from usdsplat.preview.told import NO_LIGHTS
from usdsplat.preview.values import Look
from usdsplat.render.settings import RenderSettings


def test_a_note_hides_no_warning(document, events, stage):
    """Oracle: the finding on gloss is a note and is not said; that on metal is a warning, and
    light without an effect comes after it."""
    bind(add_mesh(stage, "/M", faces=1), add_material(stage, "/Looks/Mat"))
    surface = UsdShade.Shader(stage.GetPrimAtPath("/Looks/Mat/Surface"))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.1)
    relit = replace(STATE, look=Look(settings=RenderSettings(lighting="relit")))
    drawn_by(document, relit)
    assert events.pictures[-1].warnings == (NO_LIGHTS,)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(1.0)
    drawn_by(document, relit)
    metal, light = events.pictures[-1].warnings
    assert metal.startswith("warning [unsupported-input] /Looks/Mat") and light == NO_LIGHTS
