"""Tests of stages without lights: what the window says, and the lights that it adds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import UsdLux
from PySide6.QtTest import QTest

from tests.preview.qt.conftest import wait_until
from tests.preview.qt.windows import LEFT, press, settled
from usdsplat.preview.qt.adding_lights import NO_EFFECT
from usdsplat.preview.qt.window import Window
from usdsplat.preview.qt.workspace import Workspace
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.lights import add_dome_light, add_key_light
from usdsplat.preview.told import ALONE, NO_LIGHTS
from usdsplat.render.settings import RenderSettings


def test_a_stage_without_lights_says_so_and_offers_one(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: what is shown; the new light is the selection, with handles, lies on the session
    layer, changes the picture and shines from above left of the view; undo takes it away, and the
    offer comes again."""
    offer, context = workspace.render_panel.lights, workspace.context
    workspace.right.setCurrentWidget(workspace.render_panel)
    assert offer.isHidden()
    context.set_look(settings=RenderSettings(lighting="relit"))
    wait_until(lambda: offer.isVisible())
    before = settled(workspace)
    assert NO_LIGHTS in before.warnings and window.note == NO_LIGHTS
    offer.key.click()
    wait_until(lambda: context.viewer.state.selected == ("/KeyLight",))
    wait_until(lambda: workspace.viewport.manipulator is not None)
    picture = settled(workspace)
    assert offer.isHidden() and picture.lights == 1 and not picture.warnings
    assert (picture.image != before.image).any()
    (mark,) = picture.overlays.lights
    to_world = np.reshape(mark.matrix, (4, 4))
    view = np.reshape(picture.camera.world_to_camera, (4, 4))
    right, up, back = view[:3, :3] @ to_world[:3, 2]  # it shines along its -Z
    assert right < -0.3 and up > 0.3 and back > 0.3
    assert workspace.viewport.projection is not None
    x, y = workspace.viewport.projection.pixels(mark.place)[0]
    width, height = picture.state.size
    assert 0 < x < width / 2 and 0 < y < height / 2
    press(window, "Ctrl+Z")
    wait_until(lambda: offer.isVisible())
    assert context.picture is not None and context.picture.lights == 0


def test_a_warning_is_not_said_once_it_is_over(window: Window, workspace: Workspace) -> None:
    """Oracle: the status bar, of which nothing else takes the words."""
    workspace.context.set_look(settings=RenderSettings(lighting="relit"))
    wait_until(lambda: window.note == NO_LIGHTS)
    workspace.context.set_look(settings=RenderSettings())
    wait_until(lambda: window.note == "")


def test_a_light_that_splats_do_not_show_says_so_and_offers_it(
    window: Window, workspace: Workspace
) -> None:
    """Oracle: what is said, and the picture: the button relights it, and takes back the words."""
    settled(workspace)
    window.actions_by_name["add_key"].trigger()
    wait_until(lambda: workspace.notices.sentence == NO_EFFECT)
    QTest.mouseClick(workspace.notices.button, LEFT)
    assert workspace.notices.sentence == ""
    assert workspace.context.look.settings.lighting == "relit"
    relit = settled(workspace).image
    workspace.context.set_look(settings=RenderSettings())
    assert (settled(workspace).image != relit).any()
    workspace.context.set_look(settings=RenderSettings(lighting="relit"))
    window.actions_by_name["add_dome"].trigger()
    wait_until(lambda: settled(workspace).lights == 2)
    assert workspace.notices.sentence == ""


def test_a_lone_capture_says_that_nothing_shadows_it_and_offers_its_own_shadows(
    workspace: Workspace,
) -> None:
    """Oracle: pictures: of two captures, one shadows the other; alone it looks as captured, to a
    code value; the button changes that, and takes back the words."""
    context, notices = workspace.context, workspace.notices
    context.edit(lambda edits: add_key_light(edits, context.picture.camera, (0.0, 0.0, 0.0)))
    wait_until(lambda: settled(workspace).lights == 1)
    context.set_look(settings=RenderSettings(lighting="shadowed"))
    assert not settled(workspace).warnings and notices.sentence == ""
    context.edit(lambda edits: edits.set_visible("/World/B", False))
    wait_until(lambda: notices.sentence == ALONE)
    notices.clear()
    alone = settled(workspace).image.astype(int)
    context.set_look(settings=RenderSettings(lighting="captured"))
    assert abs(settled(workspace).image - alone).max() <= 1
    context.set_look(settings=RenderSettings(lighting="shadowed"))
    wait_until(lambda: notices.sentence == ALONE)
    QTest.mouseClick(notices.button, LEFT)
    assert context.look.settings.self_shadows
    wait_until(lambda: notices.sentence == "")
    assert abs(settled(workspace).image - alone).max() > 1


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_a_dome_has_its_texture_and_its_pole_up(stage, axis: str) -> None:
    """Oracle: UsdLux: the texture that was given, and the transform that
    `DomeLight.OrientToStageUpAxis` authors on a stage of the same axis."""
    from pxr import Usd, UsdGeom

    UsdGeom.SetStageUpAxis(stage, axis)
    edits = Edits(stage)
    path = add_dome_light(edits, Path("/some/sky.exr"))
    light = UsdLux.DomeLight(stage.GetPrimAtPath(path))
    assert light.GetTextureFileAttr().Get().path == "/some/sky.exr"
    other = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(other, axis)
    like = UsdLux.DomeLight.Define(other, "/Dome")
    like.OrientToStageUpAxis()
    ours = UsdGeom.Xformable(light).GetLocalTransformation()
    np.testing.assert_allclose(ours, UsdGeom.Xformable(like).GetLocalTransformation(), atol=1e-12)
    assert stage.GetSessionLayer().GetPrimAtPath(path) is not None
    assert add_dome_light(edits) == "/DomeLight1"
    edits.undo()
    edits.undo()
    assert not stage.GetPrimAtPath(path)
