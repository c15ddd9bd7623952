"""The package: a writer by suffix."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from usdsplat import images
from usdsplat.core.errors import UnknownFormatError
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
    message = r"a\.jpg: found suffix '\.jpg', expected one of \.exr, \.png"
    with pytest.raises(UnknownFormatError, match=message):
        images.open_writer(tmp_path / "a.jpg", ImageLayout(resolution=(3, 2)))


def test_looking_up_a_color_loads_no_image_library():
    """Oracle: the modules of a fresh process."""
    code = "import sys, usdsplat.images.color, usdsplat.images.frames; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"OpenImageIO", "pxr", "numba", "colour"} & set(run.stdout.split())
