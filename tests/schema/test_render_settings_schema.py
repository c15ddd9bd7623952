"""Tests that SplatRenderSettingsAPI declares the knobs of the render settings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Usd

from usdsplat.core.knobs import Knob, knobs
from usdsplat.render.settings import RenderSettings
from usdsplat.schema import tokens

USD_TYPES = {int: "int", float: "float", bool: "bool", str: "string"}


def usd_name(item: Knob) -> str:
    """`sh_degree` as `splat:shDegree`."""
    first, *rest = item.name.split("_")
    return "splat:" + first + "".join(word.title() for word in rest)


def declared() -> Any:
    """USD's definition of the API schema."""
    return Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(tokens.SETTINGS_API)


def test_every_knob_is_a_property_and_every_property_a_knob() -> None:
    """Oracle: the knobs of the delegate's RenderSettings."""
    assert set(declared().GetPropertyNames()) == {usd_name(item) for item in knobs(RenderSettings)}


@pytest.mark.parametrize("item", knobs(RenderSettings), ids=lambda item: item.name)
def test_type_default_and_choices_agree(item: Knob) -> None:
    """Oracle: the knob."""
    attribute = declared().GetSchemaAttributeSpec(usd_name(item))
    is_float = attribute.typeName == "float"
    default = np.float32(item.default) if is_float else item.default
    assert attribute.default == default
    assert attribute.typeName == USD_TYPES.get(item.type, "token")
    assert list(attribute.allowedTokens or ()) == list(item.choices or ())


@pytest.mark.parametrize(
    ("kind", "allowed"), [("RenderSettings", True), ("RenderProduct", True), ("Mesh", False)]
)
def test_it_applies_to_settings_and_products(stage: Usd.Stage, kind: str, allowed: bool) -> None:
    """Oracle: USD's CanApplyAPI."""
    prim = stage.DefinePrim("/Prim", kind)
    assert bool(prim.CanApplyAPI(tokens.SETTINGS_API)) == allowed
