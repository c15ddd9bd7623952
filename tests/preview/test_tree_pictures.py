"""Tests of the pictures of a viewport while the nodes of a splat tree are read."""

from __future__ import annotations

import queue
import threading
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd

from tests.preview.documents import SIZE, alone, drawn_by
from tests.preview.documents import STATE as CAMERA_STATE
from tests.render.rendering import random_cloud
from tests.trees import little_tree
from usdsplat.preview.document import Document
from usdsplat.preview.pacing import FULL, Quality
from usdsplat.preview.session import Session
from usdsplat.preview.values import Look, Picture
from usdsplat.render.settings import RenderSettings
from usdsplat.schema.chunks import ChunkReader

LEAVES = RenderSettings(lod_error=0.0)
STATE = replace(CAMERA_STATE, camera=None, look=Look(settings=LEAVES))
SECONDS = 60


@pytest.fixture
def tree(tmp_path):
    """A stage with a tree that fills the view."""
    cloud = random_cloud(3, 400, 0)
    return Usd.Stage.Open(str(little_tree(tmp_path, replace(cloud, scales=0.4 * cloud.scales))))


@pytest.fixture
def gates(monkeypatch):
    """Chunk -> event without which it cannot be read; branches are chunk 1 and leaves chunk 2."""
    found = {1: threading.Event(), 2: threading.Event()}
    read = ChunkReader.read

    def gated(self, chunk, first, count):
        assert chunk not in found or found[chunk].wait(SECONDS)
        return read(self, chunk, first, count)

    monkeypatch.setattr(ChunkReader, "read", gated)
    yield found
    for gate in found.values():
        gate.set()


@pytest.fixture
def document(tree, gates, events):
    """Open, with closed gates; they open before it is closed."""
    document = Document(tree, publish=events.append)
    yield document
    for gate in gates.values():
        gate.set()
    document.close()


def level(tree, number):
    """The picture of a whole level of the tree, by an engine of its own; the gates are open."""
    errors = {0: 0.0, 2: 1000.0}
    return alone(tree, camera=None, size=SIZE, settings=replace(LEAVES, lod_error=errors[number]))


def test_a_window_at_rest_refines_its_picture_until_all_is_read(tree, document, gates, events):
    """Oracle: an engine of its own that waits, bit for bit: the first picture is the root, the last
    one the leaves. Nothing is drawn while nothing is read."""
    woken = queue.Queue()
    document.wake = lambda: woken.put(True)
    drawn_by(document, STATE)
    (first,) = events.pictures
    assert not first.is_final and first.missing == 4
    drawn_by(document, STATE)
    assert len(events.pictures) == 1 and woken.empty()
    for gate in gates.values():
        gate.set()
    while not events.pictures[-1].is_final:
        woken.get(timeout=SECONDS)
        drawn_by(document, STATE)
    last = events.pictures[-1]
    assert last.missing == 0
    np.testing.assert_array_equal(first.image, level(tree, 2))
    np.testing.assert_array_equal(last.image, level(tree, 0))
    assert (first.image != last.image).any()


def test_a_session_refines_by_itself(tree, gates):
    """Oracle: an engine of its own that waits. Nobody asks for another picture."""
    pictures = queue.Queue()

    def listen(event):
        if isinstance(event, Picture):
            pictures.put(event)

    session = Session(lambda publish: Document(tree, publish=publish))
    session.listen(listen)
    session.look(STATE)
    assert not pictures.get(timeout=SECONDS).is_final
    for gate in gates.values():
        gate.set()
    while not (last := pictures.get(timeout=SECONDS)).is_final:
        pass
    session.close()
    np.testing.assert_array_equal(last.image, level(tree, 0))


def test_coarse_levels_are_read_first_and_drawn_meanwhile(tree, document, gates, events):
    """Oracle: counts by hand. With the branches the picture has more splats than with the root, and
    still lacks the four leaves."""
    woken = queue.Queue()
    document.wake = lambda: woken.put(True)
    drawn_by(document, STATE)
    gates[1].set()
    woken.get(timeout=SECONDS)
    woken.get(timeout=SECONDS)
    drawn_by(document, STATE)
    assert [events.pictures[i].missing for i in (0, -1)] == [4, 4]
    assert events.pictures[0].splats < events.pictures[-1].splats <= 101


def test_a_still_waits(tree, document, gates, events):
    """Oracle: an engine of its own; the picture before was the root."""
    drawn_by(document, STATE)
    assert events.pictures[-1].missing
    for gate in gates.values():
        gate.set()
    still = document.still(STATE).picture
    assert still.is_final
    np.testing.assert_array_equal(still.image, level(tree, 0))


def test_a_still_is_whole_where_the_window_keeps_a_budget(tree, document, gates, monkeypatch):
    """Oracle: an engine of its own without a budget. The picture of a slow tree stays in the window
    with few splats; a still of the same view has all, and the window's picture stays."""
    few = Quality(splats=20)
    monkeypatch.setattr("usdsplat.preview.pacing.Pacer.resting", lambda self, shown, load: few)
    for gate in gates.values():
        gate.set()
    drawn_by(document, STATE)
    before = document.shown
    assert before.quality == few
    still = document.still(STATE)
    np.testing.assert_array_equal(still.picture.image, level(tree, 0))
    assert still.quality == FULL and document.shown is before
