"""Tests of command lines that are made of options."""

from __future__ import annotations

import random

import pytest

from usdsplat.cli import render, simulate
from usdsplat.cli.parsing import parse
from usdsplat.cli.words import words_of

LINES = [
    ["shot.usd"],
    ["a b.usd", "-o", "out/#x%04d.exr", "--frames", "-5--1", "--deep", "--resume"],
    ["s.usd", "--aovs", "all", "--samples", "64", "--no-motion-blur", "--lod-error", "0.1"],
    ["s.usd", "--variant", "/A:x=y", "--variant", "/A:z=ü", "--metadata", "a=b", "--float"],
    ["s.usd", "--crop=-4,-4,8,8", "--inverse-max", "1e-3"],
]


@pytest.mark.parametrize("line", LINES, ids=range(len(LINES)))
def test_words_are_parsed_into_the_same_options(line):
    """Oracle: the parser."""
    options = parse(render.Options, "render", "", line)
    assert not isinstance(options, int)
    assert parse(render.Options, "render", "", words_of(options)) == options


def test_options_of_simulations_too():
    """Oracle: the parser."""
    line = ["s.usd", "-o", "b.usda", "--set", "rd:feed=0.03", "--set", "a=b", "--max-splats", "7"]
    options = parse(simulate.Options, "simulate", "", line)
    assert parse(simulate.Options, "simulate", "", words_of(options)) == options


def test_defaults_are_left_out():
    """Oracle: by hand."""
    options = parse(render.Options, "render", "", ["s.usd", "--retries", "1", "--frames=3"])
    assert words_of(options) == ("s.usd", "--frames=3")


def test_any_order_of_flags():
    """Oracle: the parser, for random orders."""
    flags = ["--deep", "--resume", "--frames=1-2", "-o=a.exr", "--samples=4", "--no-compare"]
    for seed in range(10):
        mixed = random.Random(seed).sample(flags, len(flags))
        options = parse(render.Options, "render", "", ["s.usd", *mixed])
        assert parse(render.Options, "render", "", words_of(options)) == options
