"""Tests that an engine that followed random edits equals a new engine."""

from __future__ import annotations

import numpy as np
import pytest

from tests.delegate.edits import Editor
from tests.delegate.stages import contents
from tests.delegate.surface_stages import surfaces
from tests.folded import folded
from usdsplat.core.errors import StageError
from usdsplat.delegate.engine import Engine

AOVS = ("color", "depth", "primId", "instanceId", "elementId")
PURPOSES = (("default", "render"), ("default", "proxy", "guide"))


def cameras(engine):
    """What every camera sees, or why it does not."""
    seen = {}
    for path in engine.cameras():
        try:
            seen[path] = engine.view(path)
        except StageError as error:
            seen[path] = str(error)
    return seen


def assert_alike(engine, fresh, history):
    """All that is held, said and drawn is the same to the last bit."""
    assert contents(engine) == contents(fresh), history
    assert surfaces(engine) == surfaces(fresh), history
    assert engine.warnings == fresh.warnings, history
    assert cameras(engine) == cameras(fresh), history
    view = fresh.view(resolution=(24, 18))
    assert engine.view(resolution=(24, 18)) == view, history
    one, two = engine.picture(view, aovs=AOVS), fresh.picture(view, aovs=AOVS)
    assert all(np.array_equal(one[name], two[name]) for name in AOVS), history


def assert_follows_time(engine, editor, purposes, history):
    """Nothing but time changes from one check to the next."""
    for time in (1.0, 3.0, 2.0, None, 1.5, 1.0):
        engine.set_time(time)
        with Engine(editor.stage, time=time, purposes=purposes) as fresh:
            assert contents(engine) == contents(fresh), f"{history}, time {time}"
            assert surfaces(engine) == surfaces(fresh), f"{history}, time {time}"
            assert cameras(engine) == cameras(fresh), f"{history}, time {time}"


@pytest.mark.parametrize("seed", folded(range(8)))
def test_edits_leave_the_picture_of_a_fresh_engine(seed, tmp_path, capfd):
    """Oracle: a new engine on the edited stage, which pulls everything; some eighty edits each."""
    editor = Editor(seed, str(tmp_path))
    purposes = PURPOSES[0]
    with Engine(editor.stage) as engine:
        for step in range(60):
            history = [editor.edit() for _ in range(1 + step % 4 // 3)]
            if step % 2:
                engine.set_time(editor.pick_time())
            if step % 10 == 9:
                purposes = PURPOSES[step % 20 // 10]
                engine.set_purposes(purposes)
            with Engine(editor.stage, time=engine.time, purposes=purposes) as fresh:
                assert_alike(engine, fresh, f"seed {seed}, step {step}: {history}")
                pulled = engine.pulls
                engine.sync()
                assert engine.pulls == pulled
            if step % 15 == 14:
                assert_follows_time(engine, editor, purposes, f"seed {seed}, step {step}")
    capfd.readouterr()  # USD has a lot to say about some of these stages
