"""Tests of what follows a full picture: the next movement is prepared, and nothing is drawn."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.preview.documents import STATE, drawn_by
from usdsplat.preview.pacing import FULL, Load, Pacer, Quality
from usdsplat.preview.values import Look
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings

BLURRED = Look(settings=RenderSettings(samples=2, motion_blur=True))


@pytest.fixture
def budgeted(monkeypatch):
    """The next movement begins with one splat; the budgets that layouts were chosen for."""
    asked, whole = [], RenderScene.draw_list

    def counted(self, budget=None, *args, **options):
        if budget is not None:
            asked.append(budget)
        return (
            whole(self, *args, **options)
            if budget is None
            else whole(self, budget, *args, **options)
        )

    monkeypatch.setattr(Pacer, "first", lambda self, load: Quality(scale=3.0, splats=1))
    monkeypatch.setattr(RenderScene, "draw_list", counted)
    return asked


def test_a_movement_is_prepared_once_after_a_full_picture(document, events, budgeted):
    """Oracle: counted: one picture, and one call that chooses the splats of the budget."""
    assert document.draw(STATE) and 1 not in budgeted
    assert not document.draw(STATE) and budgeted.count(1) == 1
    assert len(events.pictures) == 1 and not document.draw(STATE)
    assert len(events.pictures) == 1


@pytest.mark.parametrize("look", [BLURRED, Look(aov="forward"), Look(aov="backward")])
def test_so_is_one_after_a_picture_that_reads_other_times(document, events, stage, budgeted, look):
    """Oracle: counted, as above; a change of the stage at any time draws it again."""
    stage.GetPrimAtPath("/Camera").GetAttribute("shutter:close").Set(0.5)
    state = replace(STATE, look=look, time=2.0)
    assert document.draw(state) and 1 not in budgeted
    assert not document.draw(state) and budgeted.count(1) == 1
    assert [each.is_final for each in events.pictures] == [True]
    stage.GetAttributeAtPath("/World/B.xformOp:translate").Set((9, 0, 0), 3)
    drawn_by(document, state)
    assert len(events.pictures) == 2
    assert (events.pictures[0].image != events.pictures[1].image).any()


def test_the_choice_of_splats_counts_to_no_cost(document, monkeypatch):
    """Oracle: added by hand: 1 ms per splat and 2 + 4 ms per pixel, whatever "lay out" took."""
    told = []
    monkeypatch.setattr(
        Pacer, "drew", lambda self, quality, load, *, fixed, rest: told.append((fixed, rest))
    )
    took = {"project": 1.0, "lay out": 100.0, "blend": 2.0}
    for _ in range(2):  # the first picture is not counted
        document._drawing._learn(FULL, took, 4.0, Load(pixels=1, splats=1))
    assert told == [(1.0, 6.0)]
