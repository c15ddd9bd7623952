"""Tests of the options of `usdsplat render` that are derived from knobs."""

from __future__ import annotations

from dataclasses import fields

from usdsplat.cli.arguments import KNOB
from usdsplat.cli.render_options import (
    ColorFlags,
    DrawingFlags,
    FileOptions,
    LevelFlags,
    LightFlags,
    SamplingFlags,
)
from usdsplat.core.knobs import knobs
from usdsplat.render.settings import RenderSettings


def test_every_knob_is_a_flag_of_one_group():
    """Oracle: the knobs of the render settings."""
    groups = (DrawingFlags, LevelFlags, LightFlags, SamplingFlags, ColorFlags, FileOptions)
    names = [item.metadata.get(KNOB) for group in groups for item in fields(group)]
    flags = [name for name in names if name is not None]
    assert sorted(flags) == sorted(knob.name for knob in knobs(RenderSettings))
