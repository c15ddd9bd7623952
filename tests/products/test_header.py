"""Tests that all writers of pictures write the same headers."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Usd

from tests.preview.flipbooks import flipbook
from usdsplat.cli.main import main
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.opening import open_document
from usdsplat.preview.saving import save_view
from usdsplat.preview.values import DisplaySettings, Look, ViewState
from usdsplat.render.settings import RenderSettings

SIZE = (48, 32)
CAMERA = "/World/Cam"
OF_ONE_FILE = {"DateTime", "capDate", "usdsplat:stamp"}
"""Entries that say when a file was written, and the one that only `render` writes."""


@pytest.fixture
def document(shot):
    """The shot as a window has it open."""
    opened = open_document(shot)
    yield opened
    opened.close()


def parts(path):
    """Of each part of a file: its channels with their types, its windows, and its entries."""
    file = oiio.ImageInput.open(str(path))
    found = []
    while file.seek_subimage(len(found), 0):
        spec = file.spec()
        entries = {item.name: item.value for item in spec.extra_attribs}
        types = [str(spec.channelformat(i)) for i in range(spec.nchannels)]
        windows = [str(spec.roi), str(spec.roi_full)]
        kept = {name: value for name, value in entries.items() if name not in OF_ONE_FILE}
        found.append((dict(zip(spec.channelnames, types, strict=True)), windows, kept))
    file.close()
    return found


@pytest.mark.parametrize(
    ("aov", "settings", "flags"),
    [
        ("color", RenderSettings(), ()),
        ("Z", RenderSettings(sorting="cameraDistance"), ("--sorting", "cameraDistance")),
        ("id", RenderSettings(samples=2), ("--samples", "2")),
        ("cryptoObject", RenderSettings(multipart=True), ("--multipart",)),
        ("P", RenderSettings(color_mode="display"), ("--color-mode", "display")),
    ],
)
def test_a_window_and_render_write_the_same_file(shot, document, tmp_path, aov, settings, flags):
    """Oracle: OpenImageIO's reader of both files: channels, windows, every entry, every pixel."""
    rendered, saved = tmp_path / "rendered.exr", tmp_path / "saved.exr"
    names = ",".join(dict.fromkeys(("color", aov)))
    words = ["render", shot, "-o", rendered, "--camera", CAMERA, "--frames", 3, "--aovs", names]
    assert main([str(word) for word in (*words, "--resolution", "48x32", *flags)]) == 0
    look = Look(aov=aov, settings=settings)
    shown = DisplaySettings(exposure=2.0, channel="red")  # of the screen, not of the file
    save_view(
        document, ViewState(size=SIZE, camera=CAMERA, time=3.0, look=look, display=shown), saved
    )
    assert parts(saved) == parts(rendered)
    entries = parts(saved)[0][2]
    assert entries["usdsplat:camera"] == CAMERA
    assert (entries["usdsplat:stage"], entries["usdsplat:frame"]) == (str(shot), 3.0)
    for number in range(len(parts(saved))):
        both = [oiio.ImageBuf(str(path), number, 0) for path in (rendered, saved)]
        kind = oiio.UINT32 if "id" in both[0].spec().channelnames else oiio.FLOAT
        pixels = [image.get_pixels(kind) for image in both]
        np.testing.assert_array_equal(*pixels)


def test_a_screenshot_says_what_a_rendered_png_says_and_how_it_was_shown(shot, document, tmp_path):
    """Oracle: Pillow's reader of both files; exposure and wipe of the screen are added."""
    from PIL import Image

    rendered, saved = tmp_path / "rendered.png", tmp_path / "saved.png"
    words = ["render", shot, "-o", rendered, "--camera", CAMERA, "--frames", 2]
    assert main([str(word) for word in (*words, "--resolution", "48x32")]) == 0
    state = ViewState(
        size=SIZE,
        camera=CAMERA,
        time=2.0,
        other=Look(time=1.0),
        wipe=0.25,
        display=DisplaySettings(exposure=1.5),
    )
    save_view(document, state, saved)
    with Image.open(rendered) as one, Image.open(saved) as other:
        expected, found = dict(one.text), dict(other.text)
    shown = {name: found.pop(name) for name in list(found) if name.startswith("usdsplat:shown:")}
    assert {name: json.loads(value) for name, value in shown.items()} == {
        "usdsplat:shown:exposure": 1.5,
        "usdsplat:shown:wipe": 0.25,
    }
    ours = {"Software"} | {
        name for name in expected if name.startswith(("usdsplat:", "world"))
    } - OF_ONE_FILE
    assert len(ours) > 8
    assert {name: found.get(name) for name in ours} == {name: expected[name] for name in ours}


def test_a_camera_that_is_no_prim_is_named_by_what_it_is(document, tmp_path):
    """Oracle: the words for a camera that frames everything, and for one that a user moves."""
    for camera, words in ((None, "framing the scene"), (FreeCamera(eye=(0, 0, 4)), "free")):
        save_view(document, ViewState(size=SIZE, camera=camera, time=1.0), tmp_path / "a.exr")
        assert parts(tmp_path / "a.exr")[0][2]["usdsplat:camera"] == words


def test_each_frame_of_a_flipbook_names_its_frame(document, tmp_path):
    """Oracle: the frames, in the headers of the files."""
    frames = (1.0, 3.0)
    files = flipbook(document, ViewState(size=SIZE, camera=CAMERA), frames, tmp_path / "a.%d.exr")
    assert tuple(parts(file)[0][2]["usdsplat:frame"] for file in files) == frames


def test_a_stage_without_a_file_goes_by_its_layer(tmp_path):
    """Oracle: the stage's own name for its root layer."""
    from usdsplat.preview.opening import document_of

    stage = Usd.Stage.CreateInMemory("nowhere.usda")
    made = document_of(stage)
    try:
        save_view(made, ViewState(size=SIZE), tmp_path / "a.exr")
    finally:
        made.close()
    name = stage.GetRootLayer().GetDisplayName()
    assert parts(tmp_path / "a.exr")[0][2]["usdsplat:stage"] == name
