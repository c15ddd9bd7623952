"""Tests that an engine that followed random edits of opaque prims equals a new engine."""

from __future__ import annotations

import pytest

from tests.delegate.stages import contents
from tests.delegate.surface_edits import SurfaceEditor
from tests.delegate.surface_stages import surfaces
from tests.folded import folded
from usdsplat.delegate.engine import Engine

PURPOSES = (("default", "render"), ("default", "proxy", "guide"))


def assert_alike(engine, fresh, history):
    """All that is held and said is the same to the last bit."""
    assert surfaces(engine) == surfaces(fresh), history
    assert contents(engine) == contents(fresh), history
    assert engine.warnings == fresh.warnings, history


@pytest.mark.parametrize("seed", folded(range(6)))
def test_edits_of_surfaces_leave_the_scene_of_a_fresh_engine(seed, tmp_path, capfd):
    """Oracle: a new engine on the edited stage, which pulls everything; some sixty edits each."""
    editor = SurfaceEditor(seed, str(tmp_path))
    purposes, levels = PURPOSES[0], 1
    with Engine(editor.stage, refinement=levels) as engine:
        for step in range(60):
            history = [editor.edit() for _ in range(1 + step % 4 // 3)]
            if step % 2:
                engine.set_time(editor.pick_time())
            if step % 10 == 9:
                purposes, levels = PURPOSES[step % 20 // 10], step % 3
                engine.set_purposes(purposes)
                engine.set_refinement(levels)
            with Engine(
                editor.stage, time=engine.time, purposes=purposes, refinement=levels
            ) as fresh:
                assert_alike(engine, fresh, f"seed {seed}, step {step}: {history}")
                pulled = engine.pulls
                engine.sync()
                assert engine.pulls == pulled
            if step % 15 == 14:
                for time in (1.0, 3.0, 2.0, None, 1.5, 1.0):
                    engine.set_time(time)
                    with Engine(
                        editor.stage, time=time, purposes=purposes, refinement=levels
                    ) as fresh:
                        assert_alike(engine, fresh, f"seed {seed}, step {step}, time {time}")
    capfd.readouterr()  # USD has a lot to say about some of these stages
