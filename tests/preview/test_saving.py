"""Tests of screenshots and flipbooks, read back by other libraries."""

from __future__ import annotations

import json
import math
import os
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.delegate.stages import add_camera, random_cloud
from tests.preview.flipbooks import flipbook
from usdsplat import schema
from usdsplat.core.cancel import CancelToken
from usdsplat.core.errors import OutputError, UnknownFormatError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.preview.document import Document
from usdsplat.preview.saving import Flipbook, save_view
from usdsplat.preview.values import DisplaySettings, Look, ViewState
from usdsplat.products import movie
from usdsplat.render.settings import RenderSettings

SIZE = (40, 30)
STATE = ViewState(size=SIZE, camera="/Camera", display=DisplaySettings(background="black"))


@pytest.fixture
def stage():
    """A cloud that goes to the right by a unit a frame, and a camera before it."""
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(25)
    move = UsdGeom.Xformable(schema.author(stage, "/Cloud", random_cloud(3, n=60))).AddTranslateOp()
    for frame in (1, 2, 3):
        move.Set(Gf.Vec3d(frame - 2, 0, 0), frame)
    add_camera(stage, eye=(0.0, 0.0, 9.0))
    return stage


@pytest.fixture
def document(stage):
    """Not in a session: these tests are its thread."""
    document = Document(stage)
    yield document
    document.close()


def pixels(path):
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def fresh(stage, time, settings=None, aovs=("color",)):
    """What an engine of its own draws."""
    with Engine(stage, time=time) as engine:
        view = engine.view("/Camera", resolution=SIZE)
        picture = engine.picture(view, settings, aovs)
        return {name: np.array(array) for name, array in picture.items()}


def test_what_no_picture_can_be_written_to_is_a_sentence(tmp_path, document):
    """Oracle: the suffixes and the folder, in the sentence; nothing is written."""
    with pytest.raises(UnknownFormatError, match=r"expected one of .*\.exr"):
        save_view(document, STATE, tmp_path / "a.gif")
    with pytest.raises(UnknownFormatError, match=r"expected one of .*\.mov"):
        flipbook(document, STATE, (1.0,), tmp_path / "a.####.gif")
    with pytest.raises(OutputError, match="found no folder"):
        save_view(document, STATE, tmp_path / "none" / "a.png")
    assert os.listdir(tmp_path) == []


def test_a_saved_view_is_the_full_picture_even_while_the_view_moves(tmp_path, stage, document):
    """Oracle: a fresh engine's picture over black, in whole steps."""
    save_view(document, replace(STATE, time=1.0, is_moving=True), tmp_path / "a.png")
    color = fresh(stage, 1.0)["color"]
    expected = np.clip(color[..., :3] * 255.0, 0, 255)
    assert abs(pixels(tmp_path / "a.png") - expected).max() <= 1
    assert expected.max() > 50


def test_an_exr_is_what_a_compositor_wants(tmp_path, stage, document):
    """Oracle: a fresh engine's scene-linear picture, as OpenImageIO reads the file; half has 11
    bits."""
    target = tmp_path / "a.exr"
    state = replace(STATE, time=3.0, look=Look(aov="Z"), display=DisplaySettings(exposure=3.0))
    save_view(document, state, target)
    file = oiio.ImageBuf(str(target))
    expected = fresh(stage, 3.0, RenderSettings(color_mode="scene"), ("color", "depth"))
    assert file.spec().channelnames == ("R", "G", "B", "A", "Z")
    read = file.get_pixels(oiio.FLOAT)
    np.testing.assert_allclose(read[..., :4], expected["color"], rtol=1e-3, atol=1e-6)
    np.testing.assert_array_equal(read[..., 4], expected["depth"])
    assert file.spec().getattribute("usdsplat:frame") == 3.0
    assert file.spec().getattribute("worldToCamera") is not None
    assert document.engine.time == 3.0


def test_an_exr_of_ids_says_whose_they_are(tmp_path, document):
    """Oracle: the header's list, by the only id there is."""
    target = tmp_path / "a.exr"
    save_view(document, replace(STATE, time=2.0, look=Look(aov="id")), target)
    ids = oiio.ImageBuf(str(target), 1, 0)
    (found,) = set(np.unique(ids.get_pixels(oiio.UINT32))) - {2**32 - 1}
    spec = oiio.ImageBuf(str(target)).spec()
    assert json.loads(spec.getattribute("usdsplat:ids"))[found] == "/Cloud"


def test_a_flipbook_is_a_picture_of_each_frame(tmp_path, stage, document):
    """Oracle: each is the screenshot of its frame; and the cloud goes right, so its middle does."""
    told = []

    class Told:
        def step(self, label, done, total):
            told.append((done, total))

    files = flipbook(document, STATE, (1.0, 2.0, 3.0), tmp_path / "f.####.png", progress=Told())
    assert [file.name for file in files] == ["f.0001.png", "f.0002.png", "f.0003.png"]
    assert told == [(1, 3), (2, 3), (3, 3)]
    middles = []
    for frame, file in zip((1.0, 2.0, 3.0), files, strict=True):
        save_view(document, replace(STATE, time=frame), tmp_path / "one.png")
        np.testing.assert_array_equal(pixels(file), pixels(tmp_path / "one.png"))
        weight = pixels(file).sum(axis=(0, 2))
        middles.append(float(weight @ np.arange(SIZE[0]) / weight.sum()))
    assert middles[0] + 2 < middles[1] < middles[2] - 2


class CancelAfter:
    """Progress that cancels once so many frames are done."""

    def __init__(self, frames):
        self.token = CancelToken()
        self.frames = frames

    def step(self, label, done, total):
        if done == self.frames:
            self.token.cancel()


def test_a_flipbook_ends_when_it_is_cancelled_and_keeps_what_is_whole(tmp_path, document):
    """Oracle: two frames were done before it was cancelled."""
    told = CancelAfter(2)
    frames, name = (1.0, 2.0, 3.0), tmp_path / "f.%d.png"
    files = flipbook(document, STATE, frames, name, progress=told, cancel=told.token)
    assert sorted(os.listdir(tmp_path)) == [file.name for file in files] == ["f.1.png", "f.2.png"]


def test_others_have_turns_between_the_frames_of_a_flipbook(tmp_path, document, events):
    """Oracle: a flipbook alone; and the viewport's listeners see their own picture, in full."""
    frames, document.publish = (1.0, 2.0), events.append
    alone = [pixels(file) for file in flipbook(document, STATE, frames, tmp_path / "a.%d.png")]
    assert not events.pictures
    book = Flipbook(STATE, frames, tmp_path / "b.%d.png")
    while book.turn(document):
        while document.draw(replace(STATE, time=2.0)):
            pass
        assert events.pictures[-1].is_final
        assert len(events.pictures) >= len(book.files)
    for file, expected in zip(book.files, alone, strict=True):
        np.testing.assert_array_equal(pixels(file), expected)
    assert {picture.state.time for picture in events.pictures} == {2.0}


@pytest.mark.parametrize(
    ("frames", "name", "error"),
    [
        ((), "f.####.png", UsageError),
        ((1.0, 2.0), "f.png", UsageError),
        ((1.0, 1.5), "f.####.png", UsageError),
        ((1.0, math.inf), "f.####.png", UsageError),
        (tuple(map(float, range(100_001))), "f.####.png", UsageError),
    ],
)
def test_a_flipbook_without_frames_or_names_for_them_is_refused(
    tmp_path, document, frames, name, error
):
    """Oracle: the house's errors, and no file."""
    with pytest.raises(error):
        flipbook(document, STATE, frames, tmp_path / name)
    assert os.listdir(tmp_path) == []


class Reel:
    """A movie that keeps its frames; what ffmpeg gets is tested with the movie itself."""

    def __init__(self, path, size, rate, *, metadata):
        self.path, self.size, self.rate, self.metadata = path, size, rate, metadata
        self.frames = []
        self.is_whole = False

    def __enter__(self):
        reels.append(self)
        return self

    def __exit__(self, kind, error, trace):
        self.is_whole = kind is None

    def write(self, image):
        self.frames.append(image)


reels: list[Reel] = []


@pytest.fixture
def _reel(monkeypatch):
    reels.clear()
    monkeypatch.setattr(movie, "Movie", Reel)
    monkeypatch.setattr(movie, "program_for", lambda path: "a reel")


@pytest.mark.usefixtures("_reel")
def test_a_movie_has_every_frame_at_the_rate_of_the_stage(tmp_path, document):
    """Oracle: the flipbook of pictures."""
    target = tmp_path / "f.mp4"
    assert flipbook(document, STATE, (1.0, 2.0), target) == (target,)
    files = flipbook(document, STATE, (1.0, 2.0), tmp_path / "f.%d.png")
    (reel,) = reels
    assert (reel.size, reel.rate, reel.is_whole) == (SIZE, 25.0, True)
    assert reel.metadata["usdsplat:frame"] == 1.0
    for frame, file in zip(reel.frames, files, strict=True):
        np.testing.assert_array_equal(frame, pixels(file))


@pytest.mark.usefixtures("_reel")
def test_a_cancelled_movie_is_none(tmp_path, document):
    """Oracle: half a movie is no file."""
    told = CancelAfter(1)
    frames = (1.0, 2.0, 3.0)
    target = tmp_path / "f.mov"
    assert flipbook(document, STATE, frames, target, progress=told, cancel=told.token) == ()
    assert (len(reels[0].frames), reels[0].is_whole) == (1, False)


def test_what_the_stage_reads_is_never_replaced(tmp_path, document):
    """Oracle: the sentence, and the layer as it was."""
    from pxr import Sdf

    layer = tmp_path / "frames.0001.png.usda"
    Sdf.Layer.CreateNew(str(layer)).Save()
    before = layer.read_bytes()
    target = tmp_path / "frames.0001.png"
    os.link(layer, target)
    document.stage.GetRootLayer().subLayerPaths.append(str(layer))
    for write in (
        lambda: save_view(document, ViewState(), target),
        lambda: flipbook(document, ViewState(), (1.0, 2.0), tmp_path / "frames.####.png"),
    ):
        with pytest.raises(OutputError, match="a file that is being read, expected another name"):
            write()
    assert target.read_bytes() == before
    assert not (tmp_path / "frames.0002.png").exists()
