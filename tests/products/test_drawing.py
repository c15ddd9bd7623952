"""Tests of drawing sequences of pictures into files."""

from __future__ import annotations

import os
from functools import partial

import pytest
from pxr import Usd

from usdsplat.core.cancel import CancelToken
from usdsplat.core.errors import OutputError
from usdsplat.delegate.engine import Engine
from usdsplat.products.drawing import draw_frames
from usdsplat.products.planning import plan_pictures
from usdsplat.products.preparing import DrawOptions
from usdsplat.products.request import RenderRequest


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
                engine, RenderRequest(output=str(tmp_path / "a.%d.exr"), resolution=(64, 40))
            ),
            *plan_pictures(
                engine,
                RenderRequest(output=str(tmp_path / "b.%d.exr"), resolution=(8, 8), deep=True),
            ),
        ]
        drawn = draw_frames(engine, pictures, (1.0, 2.0), source="shot", progress=heard)
        assert len(list(drawn)) == 4
    assert {(label, total) for label, _, total in heard.steps} == {("4 pictures, row", 96)}
    assert [done for _, done, _ in heard.steps] == [0, 40, 48, 88, 96]


@pytest.fixture
def plans(shot, tmp_path):
    """Three frames of the shot, and the engine that draws them."""
    with Engine(Usd.Stage.Open(str(shot)), time=1.0) as engine:
        request = RenderRequest(output=str(tmp_path / "a.%d.exr"), resolution=(48, 32))
        yield partial(draw_frames, engine, plan_pictures(engine, request), source="shot")


def names(folder):
    return sorted(path.name for path in folder.glob("*.exr"))


class CancelAt(Heard):
    """A listener that cancels when so many rows are done."""

    def __init__(self, rows):
        super().__init__()
        self.token = CancelToken()
        self.rows = rows

    def step(self, label, done, total):
        super().step(label, done, total)
        if done == self.rows:
            self.token.cancel()


def test_cancelling_keeps_complete_pictures_and_nothing_else(plans, tmp_path):
    """Oracle: the files; it is cancelled with the last row of the second of three pictures, before
    that file is closed."""
    heard = CancelAt(64)
    drawn = list(plans((1.0, 2.0, 3.0), progress=heard, cancel=heard.token))
    assert [picture.frame for picture in drawn] == [1.0]
    assert names(tmp_path) == ["a.1.exr"]
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    before = CancelToken()
    before.cancel()
    assert list(plans((2.0,), cancel=before)) == []


@pytest.mark.parametrize(("existing", "frames"), [("resume", [1, 3]), ("replace", [1, 2, 3])])
def test_pictures_that_exist_are_kept_or_replaced(plans, tmp_path, existing, frames):
    """Oracle: the frames that are drawn, and the time of the file that was there."""
    list(plans((2.0,)))
    os.utime(tmp_path / "a.2.exr", (1, 1))
    drawn = plans((1.0, 2.0, 3.0), options=DrawOptions(existing=existing))
    assert [picture.frame for picture in drawn] == frames
    assert ((tmp_path / "a.2.exr").stat().st_mtime == 1) == (existing == "resume")


def test_pictures_that_exist_can_be_an_error_before_any_is_drawn(plans, tmp_path):
    """Oracle: the sentence, and the folder as it was."""
    (tmp_path / "a.2.exr").write_bytes(b"here already")
    with pytest.raises(OutputError, match=r"a\.2\.exr: found a file, expected a new name"):
        list(plans((1.0, 2.0), options=DrawOptions(existing="error")))
    assert names(tmp_path) == ["a.2.exr"]
