"""What `usdsplat render` remarks on, and what it keeps to itself."""

from __future__ import annotations

from dataclasses import fields

import pytest
from pxr import Usd, UsdGeom

from tests.cli.test_render import SMALL
from usdsplat.cli.parsing import KNOB
from usdsplat.cli.render_options import ColorFlags, DrawingFlags, FileOptions, SamplingFlags
from usdsplat.core.knobs import knobs
from usdsplat.delegate.engine import Engine
from usdsplat.products.drawing import draw_frames
from usdsplat.products.planning import plan_pictures
from usdsplat.products.request import RenderRequest
from usdsplat.render.settings import RenderSettings

pytestmark = pytest.mark.usefixtures("compiled")


def change(shot, edit):
    """Edit a stage file."""
    stage = Usd.Stage.Open(str(shot))
    edit(stage)
    stage.GetRootLayer().Save()


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (lambda s: s.RemovePrim("/World/Ball"), "the stage has no splats"),
        (lambda s: UsdGeom.Imageable(s.GetPrimAtPath("/World")).MakeInvisible(), "all splats are"),
        (
            lambda s: (
                s.GetPrimAtPath("/World/Cam").GetAttribute("xformOp:translate").Set((0, 0, -9))
            ),
            "no splats are in view",
        ),
    ],
)
def test_a_picture_of_nothing_says_why_once(run, shot, tmp_path, edit, why):
    """Oracle: the stage is changed so that nothing can be seen; status 0, one line for a
    sequence."""
    change(shot, edit)
    status, out, err = run("render", shot, "-o", tmp_path / "a.#.png", *SMALL)
    assert (status, len(out.splitlines())) == (0, 4)
    assert err.startswith(f"usdsplat: {tmp_path}/a.1.png: nothing is drawn: {why}")
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


class Heard:
    """A listener to progress."""

    def __init__(self):
        self.steps = []

    def step(self, label, done, total):
        self.steps.append((label, done, total))


def test_progress_is_one_for_all_frames_and_pictures(shot, tmp_path):
    """Oracle: rows of all pictures by hand: 2 frames of 40 rows in one band, and of 8."""
    heard = Heard()
    with Engine(Usd.Stage.Open(str(shot)), time=1.0) as engine:
        pictures = [
            *plan_pictures(
                engine, RenderRequest(output=str(tmp_path / "a.#.exr"), resolution=(64, 40))
            ),
            *plan_pictures(
                engine,
                RenderRequest(output=str(tmp_path / "b.#.exr"), resolution=(8, 8), deep=True),
            ),
        ]
        drawn = draw_frames(engine, pictures, (1.0, 2.0), source="shot", progress=heard)
        assert len(list(drawn)) == 4
    assert {(label, total) for label, _, total in heard.steps} == {("4 pictures, row", 96)}
    assert [done for _, done, _ in heard.steps] == [0, 40, 48, 88, 96]


def test_every_knob_is_a_flag_of_one_group():
    """Oracle: the knobs of the render settings."""
    groups = (DrawingFlags, SamplingFlags, ColorFlags, FileOptions)
    names = [item.metadata.get(KNOB) for group in groups for item in fields(group)]
    flags = [name for name in names if name is not None]
    assert set(flags) == {knob.name for knob in knobs(RenderSettings)}
    switches = [knob.name for knob in knobs(RenderSettings) if knob.type is bool]
    assert len(flags) == len(set(flags)) + len(switches)
