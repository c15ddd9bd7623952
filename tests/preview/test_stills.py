"""Tests of pictures that are saved: the viewport's own picture stays the last one."""

from __future__ import annotations

from dataclasses import replace

from tests.preview.documents import STATE, drawn_by
from usdsplat.preview.picking import in_box, pick
from usdsplat.preview.values import Look


def test_a_still_of_another_size_leaves_picks_where_they_were(document):
    """Oracle: the pick, the box and the picture before it."""
    drawn_by(document, STATE)
    before = document.shown, pick(document, 32, 24), in_box(document, 30, 20, 60, 30)
    assert before[1] is not None
    still = document.still(replace(STATE, size=(160, 40), time=5.0))
    assert still.picture.image.shape == (40, 160, 3)
    after = document.shown, pick(document, 32, 24), in_box(document, 30, 20, 60, 30)
    assert after == before


def test_a_still_that_ends_a_comparison_leaves_no_picture_of_a_closed_engine(document, events):
    """Oracle: no picture to read from, until the next one is drawn."""
    compared = replace(STATE, time=1.0, other=Look(time=5.0))
    drawn_by(document, compared)
    document.still(replace(STATE, time=1.0))
    assert document.shown is None
    count = len(events.pictures)
    drawn_by(document, compared)
    assert len(events.pictures) > count and document.shown is not None
