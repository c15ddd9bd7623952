"""Tests of two looks side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.preview.documents import STATE, alone, drawn_by
from usdsplat.core.errors import UsdSplatError
from usdsplat.delegate.engine import Engine
from usdsplat.preview.document import Document
from usdsplat.preview.probe import probe
from usdsplat.preview.values import Look
from usdsplat.render.settings import RenderSettings


def test_a_comparison_is_cut_at_the_wipe(document, events, stage):
    """Oracle: both pictures by engines of their own."""
    drawn_by(document, replace(STATE, time=1.0, other=Look(time=6.0), wipe=0.25))
    image = events.pictures[-1].image
    np.testing.assert_array_equal(image[:, :16], alone(stage, time=1.0)[:, :16])
    np.testing.assert_array_equal(image[:, 16:], alone(stage, time=6.0)[:, 16:])


def test_sides_with_other_settings_share_an_engine(document, events, stage, monkeypatch):
    """Oracle: engines of their own, and counted."""
    opened = []
    monkeypatch.setattr(
        "usdsplat.preview.document.Engine", lambda *args, **options: opened.append(args)
    )
    settings = RenderSettings(sh_degree=0)
    drawn_by(document, replace(STATE, other=Look(settings=settings), wipe=0.5))
    image = events.pictures[-1].image
    np.testing.assert_array_equal(image[:, :32], alone(stage)[:, :32])
    np.testing.assert_array_equal(image[:, 32:], alone(stage, settings=settings)[:, 32:])
    assert not opened


def test_sides_with_other_aovs_are_drawn_at_once(document, events, monkeypatch):
    """Oracle: counted, and the halves shown alone."""
    calls = []
    draw = Engine.picture

    def counting(engine, view, settings, aovs, **options):
        calls.append(aovs)
        return draw(engine, view, settings, aovs, **options)

    monkeypatch.setattr(Engine, "picture", counting)
    drawn_by(document, replace(STATE, other=Look(aov="Z")))
    assert calls == [("color", "depth")]
    drawn_by(document, replace(STATE, look=Look(aov="Z")))
    assert len(calls) == 1
    both, depth = (picture.image for picture in events.pictures)
    np.testing.assert_array_equal(both[:, 32:], depth[:, 32:])


def test_a_wipe_draws_nothing_anew(document, events, monkeypatch):
    """Oracle: counted."""
    state = replace(STATE, time=1.0, other=Look(time=6.0))
    drawn_by(document, state)
    monkeypatch.setattr(Engine, "picture", None)
    drawn_by(document, replace(state, wipe=0.75))
    assert len(events.pictures) == 2


def test_the_engine_of_a_comparison_is_closed_when_it_ends(stage, events, monkeypatch):
    """Oracle: engines that were opened and closed, counted."""
    alive = set()
    open_, close = Engine.__init__, Engine.close
    monkeypatch.setattr(
        Engine, "__init__", lambda self, *a, **o: (alive.add(id(self)), open_(self, *a, **o))[1]
    )
    monkeypatch.setattr(Engine, "close", lambda self: (alive.discard(id(self)), close(self))[1])
    document = Document(stage, publish=events.append)
    assert len(alive) == 1
    for other, count in ((Look(time=6.0), 2), (Look(time=3.0), 2), (None, 1), (Look(time=2.0), 2)):
        drawn_by(document, replace(STATE, time=1.0, other=other))
        assert len(alive) == count
    document.close()
    assert not alive


def test_a_playhead_that_crosses_the_time_of_a_comparison_opens_nothing_anew(
    document, events, monkeypatch
):
    """Oracle: engines that were opened, counted, and the right halves, which are all alike."""
    opened = []
    open_ = Engine.__init__
    monkeypatch.setattr(
        Engine, "__init__", lambda self, *a, **o: (opened.append(1), open_(self, *a, **o))[1]
    )
    for time in (1.0, 6.0, 2.0):
        drawn_by(document, replace(STATE, time=time, other=Look(time=6.0)))
    assert len(opened) == 1
    first, *others = (picture.image[:, 32:] for picture in events.pictures)
    for other in others:
        np.testing.assert_array_equal(other, first)


def test_nobody_reads_pixels_with_an_engine_that_is_closed(document):
    """Oracle: a person's expectation; the picture that ends the comparison cannot be drawn."""
    drawn_by(document, replace(STATE, time=1.0, other=Look(time=6.0), wipe=0.0))
    assert probe(document, 10, 10) is not None
    with pytest.raises(UsdSplatError):
        document.draw(replace(STATE, camera="/Nowhere"))
    assert probe(document, 10, 10) is None
    drawn_by(document, STATE)
    assert probe(document, 10, 10) is not None
