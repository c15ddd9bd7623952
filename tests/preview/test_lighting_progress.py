"""Tests of pictures whose light takes long: what is shown meanwhile, and what ends it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdLux

from tests.delegate.stages import add_camera, two_fields
from tests.preview.documents import SIZE, STATE, alone
from usdsplat.core.cancel import CancelToken
from usdsplat.preview import drawing_progress, light_times
from usdsplat.preview.document import Document
from usdsplat.preview.session import Session
from usdsplat.preview.values import Busy, Look, Picture
from usdsplat.render.settings import RenderSettings

LIT = RenderSettings(lighting="shadowed", self_shadows=True, light_samples=4)
SHADOWED = replace(STATE, look=Look(settings=LIT))


def lit():
    """Two fields over a plate, and a light."""
    stage = two_fields()
    add_camera(stage)
    light = UsdLux.SphereLight.Define(stage, "/Key")
    light.AddTranslateOp().Set(Gf.Vec3d(0.5, 4.0, 2.0))
    light.CreateIntensityAttr(30.0)
    plate = UsdGeom.Mesh.Define(stage, "/World/Plate")
    plate.CreatePointsAttr([(-3, -3, -1), (3, -3, -1), (3, 3, -1), (-3, 3, -1)])
    plate.CreateFaceVertexCountsAttr([4])
    plate.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    return stage


@pytest.fixture
def document(events):
    made = Document(lit(), publish=events.append)
    yield made
    made.close()


def test_the_last_light_is_shown_until_a_new_one_is_computed(document, events, monkeypatch):
    """Oracle: the picture of another engine with the same settings, bit for bit, in the end; before
    that one that says that it lacks its light and is not final. After the light has moved, the
    picture that does not wait has the splats of before."""
    monkeypatch.setattr(light_times, "QUICK", -1.0)
    while document.draw(SHADOWED):
        pass
    first, last = events.pictures[0], events.pictures[-1]
    assert first.lacks_light and not first.is_final
    assert last.is_final and not last.lacks_light
    np.testing.assert_array_equal(last.image, alone(document.stage, settings=LIT))
    events.clear()
    document.edits.set_value("/Key.xformOp:translate", (-4.0, 2.0, 1.0))
    while document.draw(SHADOWED):
        pass
    assert [each.lacks_light for each in events.pictures] == [True, False]
    moved = alone(document.stage, settings=LIT)
    np.testing.assert_array_equal(events.pictures[-1].image, moved)
    assert (events.pictures[0].image != moved).any()


def test_a_movement_does_not_wait_for_light(document, events, monkeypatch):
    """Oracle: the statistics of the engine: no sample of a light was computed."""
    monkeypatch.setattr(light_times, "QUICK", -1.0)
    document.draw(replace(SHADOWED, is_moving=True))
    assert document.engine.stats.light_steps == 0
    assert events.pictures[-1].lacks_light


def test_light_that_takes_little_time_is_part_of_a_movement(document, events, monkeypatch):
    """Oracle: the same statistics, after a first light that took less than any limit."""
    monkeypatch.setattr(light_times, "QUICK", 1e9)
    while document.draw(SHADOWED):
        pass
    document.edits.set_value("/Key.xformOp:translate", (-4.0, 2.0, 1.0))
    document.draw(replace(SHADOWED, is_moving=True))
    assert not events.pictures[-1].lacks_light
    assert document.engine.stats.light_steps > 0


class AfterSteps(CancelToken):
    """Cancelled once some samples of a light are done."""

    def __init__(self, events, most):
        super().__init__()
        self.events, self.most = events, most

    def check(self):
        if sum(isinstance(e, Busy) and e.done >= self.most for e in self.events):
            self.cancel()
        super().check()


def test_samples_of_lights_are_counted_and_a_change_ends_them(document, events, monkeypatch):
    """Oracle: the events: the samples in order, with their number, then that it is over; the last
    ones never come when the picture is cancelled, and the light is whole in the next one."""
    monkeypatch.setattr(drawing_progress, "PATIENCE", 0.0)
    monkeypatch.setattr(drawing_progress, "INTERVAL", 0.0)
    monkeypatch.setattr(light_times, "QUICK", -1.0)
    assert document.draw(SHADOWED)
    events.clear()
    assert not document.draw(SHADOWED, AfterSteps(events, 2))
    told = [each for each in events if isinstance(each, Busy)]
    counted = [each for each in told if each.what == "lighting"]
    assert [each.done for each in counted] == [0, 1, 2] and counted[0].total > 2
    assert told[-1] == Busy(what="", of_picture=True) and not events.pictures
    while document.draw(SHADOWED):
        pass
    np.testing.assert_array_equal(events.pictures[-1].image, alone(document.stage, settings=LIT))


@pytest.mark.parametrize("change", ["look", "edit"])
def test_a_change_ends_the_light_of_what_was_wanted_before(events, monkeypatch, change):
    """Oracle: the pictures that a session publishes: none of the light that is no longer wanted,
    which the change came in the middle of; the last one is that of another engine."""
    monkeypatch.setattr("usdsplat.preview.session.PATIENCE", 0.0)
    monkeypatch.setattr(drawing_progress, "PATIENCE", 0.0)
    monkeypatch.setattr(drawing_progress, "INTERVAL", 0.0)
    stage = lit()
    session = Session(lambda publish: Document(stage, publish=publish), own_thread=False)

    def changed(event):
        if isinstance(event, Busy) and event.done == 1 and not seen:
            seen.append(event)
            if change == "look":
                session.look(STATE)
            else:
                session.interrupt()
                session.ask(lambda d: d.edits.set_value("/Key.inputs:intensity", 3.0))

    seen = []
    session.listen(events.append)
    session.listen(changed)
    session.look(SHADOWED)
    while session.turn():
        pass
    assert seen
    pictures = [each for each in events if isinstance(each, Picture)]
    settings = None if change == "look" else LIT
    assert [each for each in pictures if each.is_final] == pictures[-1:]
    np.testing.assert_array_equal(pictures[-1].image, alone(stage, settings=settings))
    assert pictures[-1].state.size == SIZE
    session.close()
