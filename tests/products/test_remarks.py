"""Tests of the findings on pictures of `usdsplat render`."""

from __future__ import annotations

import pytest
from pxr import Usd, UsdGeom

from tests.cli.test_render import SMALL

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
