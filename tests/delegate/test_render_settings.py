from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd

from usdsplat import schema
from usdsplat.core.knobs import knobs
from usdsplat.render.settings import RenderSettings, usd_names


@pytest.mark.parametrize(
    ("asked", "hints", "expected"),
    [
        ("auto", [], "zDepth"),
        ("auto", ["cameraDistance", "cameraDistance"], "cameraDistance"),
        ("auto", ["cameraDistance", "zDepth"], "zDepth"),
        ("auto", ["rayHitDistance"], "rayHitDistance"),
        ("zDepth", ["cameraDistance"], "zDepth"),
        ("cameraDistance", ["zDepth"], "cameraDistance"),
    ],
)
def test_auto_sorting_is_what_the_prims_agree_on(asked, hints, expected):
    """Oracle: the rule as the schema's documentation has it."""
    assert RenderSettings(sorting=asked).resolved(hints).sorting == expected


def test_auto_color_is_display_in_memory():
    """Oracle: the rule as the schema's documentation has it."""
    assert RenderSettings().resolved([]).color_mode == "display"
    assert RenderSettings(color_mode="scene").resolved([]).color_mode == "scene"


def test_the_schema_and_the_knobs_are_the_same_list():
    """Oracle: USD's own registry: names, defaults and choices of SplatRenderSettingsAPI."""
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(schema.tokens.SETTINGS_API)
    assert set(usd_names()) == set(definition.GetPropertyNames())
    known = {item.name: item for item in knobs(RenderSettings)}
    for name, knob in usd_names().items():
        fallback, default = definition.GetAttributeFallbackValue(name), known[knob].default
        is_float = isinstance(default, float)
        assert fallback == (np.float32(default) if is_float else default)
        tokens = definition.GetPropertyMetadata(name, "allowedTokens")
        assert tokens is None or tuple(tokens) == known[knob].choices
