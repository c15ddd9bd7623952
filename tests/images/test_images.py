"""Tests of the choice of a writer by suffix."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest

from usdsplat import images
from usdsplat.core.errors import OutputError, UnknownFormatError
from usdsplat.images.layout import ImageLayout


@pytest.mark.parametrize(
    ("name", "magic", "mode"),
    [
        ("a.exr", b"\x76\x2f\x31\x01", "scene"),
        ("b.EXR", b"\x76\x2f\x31\x01", "scene"),
        ("a.v2.png", b"\x89PNG", "display"),
    ],
)
def test_the_suffix_chooses_format_and_color_mode(tmp_path, name, magic, mode):
    """Oracle: the first bytes that each format's specification demands."""
    layout = ImageLayout(resolution=(3, 2), color_space="srgb_rec709_display")
    with images.open_writer(tmp_path / name, layout) as writer:
        writer.write_band(0, {"color": np.zeros((2, 3, 4), np.float32)})
    assert (tmp_path / name).read_bytes().startswith(magic)
    assert images.default_color_mode(name) == mode


def test_a_suffix_nobody_writes_is_refused_with_those_we_do(tmp_path):
    """Oracle: one sentence, where: found X, expected Y."""
    message = r"a\.gif: found suffix '\.gif', expected one of \.exr, \.png, \.jpg, \.jpeg, \.webp"
    with pytest.raises(UnknownFormatError, match=message):
        images.open_writer(tmp_path / "a.gif", ImageLayout(resolution=(3, 2)))


def test_looking_up_a_color_loads_no_image_library():
    """Oracle: the modules of a fresh process."""
    code = "import sys, usdsplat.images.color, usdsplat.images.frame_numbers; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"OpenImageIO", "pxr", "numba", "colour"} & set(run.stdout.split())


@contextmanager
def small_disk():
    """No file may grow beyond 4096 bytes. For a few lines only: where the tests' own output goes to
    a file, it is one of them."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize(
    ("name", "aovs"), [("a.png", ("color",)), ("a.exr", ("color",)), ("a.exr", ("color", "id"))]
)
def test_a_full_disk_leaves_no_picture_rather_than_part_of_one(tmp_path, name, aovs):
    """Oracle: the folder, empty as before, and a sentence that names the file."""
    rng = np.random.default_rng(0)
    band = {
        "color": rng.uniform(0, 1, (64, 64, 4)).astype(np.float32),
        "id": rng.integers(0, 2**32, (64, 64), np.uint32),
    }
    layout = ImageLayout(resolution=(64, 64), aovs=aovs, color_space="srgb_rec709_display")
    with (
        small_disk(),
        pytest.raises(OutputError, match=rf"{name}: found .+, expected a [pw]") as caught,
        images.open_writer(tmp_path / name, layout) as writer,
    ):
        writer.write_band(0, band)
    assert str(caught.value).count(name) <= 2
    assert list(tmp_path.iterdir()) == []


def test_ids_that_cannot_wait_are_a_sentence(tmp_path):
    """Oracle: the ids of this picture alone are larger than the disk; the colours are not."""
    layout = ImageLayout(resolution=(64, 64), aovs=("color", "id"))
    band = {
        "color": np.zeros((64, 64, 4), np.float32),
        "id": np.zeros((64, 64), np.uint32),
    }
    with (
        small_disk(),
        pytest.raises(
            OutputError, match="no space for the temporary file of a later EXR part, expected a"
        ),
        images.open_writer(tmp_path / "a.exr", layout) as writer,
    ):
        writer.write_band(0, band)
    assert list(tmp_path.iterdir()) == []


def test_writers_can_be_told_to_use_fewer_threads():
    """Oracle: OpenImageIO's own attribute."""
    import OpenImageIO

    before = OpenImageIO.get_int_attribute("threads")
    images.limit_threads(1)
    assert OpenImageIO.get_int_attribute("threads") == images.thread_count() == 1
    images.limit_threads(before)
