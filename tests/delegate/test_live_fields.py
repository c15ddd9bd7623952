"""Tests of splats that an engine draws in place of those on the stage."""

from __future__ import annotations

import numpy as np
import pytest

from tests.delegate.stages import contents, random_cloud, two_fields
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.live_clouds import LiveClouds


def live(time: float = 3.0, **options: object) -> LiveClouds:
    """Other splats for one of the fields, of another number."""
    return LiveClouds(time=time, clouds={"/World/A": random_cloud(7, n=20)}, **options)


def test_they_are_drawn_at_their_time_only() -> None:
    """Oracle: a stage on which these splats are authored, and the stage without them."""
    stage, other = two_fields(), two_fields()
    schema.author(other, "/World/A", random_cloud(7, n=20))
    with Engine(stage, time=3.0) as engine, Engine(other, time=3.0) as expected:
        before, after = contents(engine), contents(expected)
        engine.show_live(live())
        assert contents(engine) == after
        engine.set_time(4.0)
        assert contents(engine) == before
        engine.set_time(3.0)
        assert contents(engine) == after
        engine.show_live(None)
        assert contents(engine) == before


def test_nothing_is_read_again_without_a_change() -> None:
    """Oracle: the number of reads: one for each change of the value, none without."""
    with Engine(two_fields(), time=3.0) as engine:
        engine.sync()
        value = live()
        for expected in (1, 0, 0):
            before = engine.pulls["field"]
            engine.show_live(value)
            engine.sync()
            assert engine.pulls["field"] - before == expected


def test_edits_of_the_stage_are_followed_meanwhile() -> None:
    """Oracle: the hint that is authored; the splats stay those of the value."""
    stage = two_fields()
    with Engine(stage, time=3.0) as engine:
        engine.show_live(live())
        before = contents(engine)
        attribute = stage.GetPrimAtPath("/World/A").GetAttribute("sortingModeHint")
        attribute.Set("cameraDistance")
        after = contents(engine)
        assert "cameraDistance" in after[0] and len(engine.render_scene.drawn()) == 2
        assert [each[5:] for each in after] == [each[5:] for each in before]


def test_a_field_without_splats_is_not_drawn() -> None:
    """Oracle: the paths that are drawn; unknown paths are ignored."""
    none = {"/World/A": random_cloud(1, n=0), "/World/C": random_cloud(2)}
    with Engine(two_fields(), time=3.0) as engine:
        engine.show_live(LiveClouds(time=3.0, clouds=none))
        assert engine.drawn_paths() == ("/World/B",)


@pytest.mark.parametrize("moves", [False, True])
def test_authored_normals_are_those_of_splats_that_stay(moves: bool) -> None:
    """Oracle: whether the value says that the splats move."""
    stage = two_fields()
    ones = np.ones(12, np.float32)
    normals = np.tile(np.float32([0, 1, 0]), (12, 1))
    prim = stage.GetPrimAtPath("/World/A")
    schema.author_surface(prim, normals=normals, confidence=ones, occlusion=ones)
    paths = frozenset(["/World/A"] if moves else [])
    clouds = {"/World/A": random_cloud(1)}
    with Engine(stage, time=3.0) as engine:
        engine.show_live(LiveClouds(time=3.0, clouds=clouds, moving=paths))
        spec = engine.render_scene.drawn()[0][1].spec
        assert (spec.surface is None) == moves
