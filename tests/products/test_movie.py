"""Tests of movies, with a replacement for ffmpeg that records its input, and with the real one."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest

from usdsplat.core.errors import OutputError
from usdsplat.images import open_writer
from usdsplat.images.exif import DESCRIPTION, SOFTWARE, WRITER
from usdsplat.images.layout import ImageLayout
from usdsplat.products.movie import Movie, save_animation

SCRIPT = """#!{python}
import pathlib, sys
pathlib.Path({log!r}).write_text("\\n".join(sys.argv[1:]))
{rest}
"""
GOOD = "pathlib.Path(sys.argv[-1]).write_bytes(sys.stdin.buffer.read())"
BAD = 'print("[x] a\\nUnknown encoder libx264", file=sys.stderr); sys.exit(8)'
SILENT = "sys.exit(3)"


@pytest.fixture
def ffmpeg(tmp_path, monkeypatch):
    """Put an ffmpeg on PATH whose program ends with the given lines; returns what it was told."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))

    def put(rest):
        script = folder / "ffmpeg"
        log = tmp_path / "argv"
        script.write_text(SCRIPT.format(python=sys.executable, log=str(log), rest=rest))
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        return lambda: log.read_text().split("\n")

    return put


def frames(count, rows=6, columns=8):
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (rows, columns, 3), np.uint8) for _ in range(count)]


@pytest.mark.skipif(os.name == "nt", reason="scripts of Unix")
def test_ffmpeg_gets_the_pixels_of_every_frame_in_order(ffmpeg, tmp_path):
    """Oracle: the bytes that arrive at a program of ours, which writes them into the file."""
    told = ffmpeg(GOOD)
    target = tmp_path / "out.mov"
    pictures = frames(3)
    metadata = {"usdsplat:stage": "a=b.usda", "usdsplat:frame": 2.0}
    header = {**metadata, "framesPerSecond": Fraction(24000, 1001)}
    with Movie(target, (8, 6), 23.976, metadata=header) as movie:
        for picture in pictures:
            movie.write(picture)
        assert not target.exists()
    assert target.read_bytes() == b"".join(picture.tobytes() for picture in pictures)
    arguments = told()
    for flag, value in {"-s": "8x6", "-framerate": "23.976", "-f": "rawvideo"}.items():
        assert arguments[arguments.index(flag) + 1] == value
    key, _, comment = arguments[arguments.index("-metadata") + 1].partition("=")
    assert (key, json.loads(comment)) == (
        "comment",
        {**metadata, "framesPerSecond": "24000/1001"},
    )
    assert sorted(os.listdir(tmp_path)) == ["argv", "bin", "out.mov"]


@pytest.mark.skipif(os.name == "nt", reason="scripts of Unix")
@pytest.mark.parametrize(
    ("rest", "words"), [(BAD, "Unknown encoder libx264"), (SILENT, "status 3")]
)
def test_what_ffmpeg_says_is_the_error_and_nothing_is_left(ffmpeg, tmp_path, rest, words):
    """Oracle: its last line, in one sentence; an older file is untouched."""
    ffmpeg(rest)
    target = tmp_path / "out.mp4"
    target.write_bytes(b"old")
    refused = pytest.raises(OutputError, match=f"found ffmpeg ended with {words}, expected")
    with refused, Movie(target, (8, 6), 24) as movie:
        for picture in frames(20_000):  # more than a pipe holds
            movie.write(picture)
    assert target.read_bytes() == b"old"
    assert sorted(os.listdir(tmp_path)) == ["argv", "bin", "out.mp4"]


@pytest.mark.skipif(os.name == "nt", reason="scripts of Unix")
def test_an_interrupted_movie_leaves_neither_file_nor_process(ffmpeg, tmp_path):
    """Oracle: the folder's listing, and the end of a program that would wait for ever."""
    ffmpeg("import time; time.sleep(600)")
    movie = Movie(tmp_path / "out.mp4", (8, 6), 24)
    with pytest.raises(KeyboardInterrupt), movie:
        movie.write(frames(1)[0])
        raise KeyboardInterrupt
    assert movie._process.returncode is not None
    assert sorted(set(os.listdir(tmp_path)) - {"argv"}) == ["bin"]


def test_without_ffmpeg_the_error_names_it(tmp_path, monkeypatch):
    """Oracle: one sentence with both ways out."""
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = pytest.raises(OutputError, match=r"found no ffmpeg, expected ffmpeg on PATH.*\.png")
    with refused, Movie(tmp_path / "out.mp4", (8, 6), 24):
        pass
    assert os.listdir(tmp_path) == []


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg on PATH")
@pytest.mark.parametrize("suffix", [".mp4", ".MOV"])
def test_the_real_one_makes_a_movie_of_the_same_colours(tmp_path, suffix):
    """Oracle: ffmpeg's own decoder by BT.709; 8-bit chroma and H.264 cost a few steps. H.264 halves
    chroma, so an odd row gets another like it."""
    colours = np.array([[220, 30, 40], [30, 200, 60], [40, 50, 230], [128, 128, 128]], np.uint8)
    target = tmp_path / f"out{suffix}"
    with Movie(target, (64, 47), 24) as movie:
        for colour in colours:
            movie.write(np.broadcast_to(colour, (47, 64, 3)))
    shown = ["-vf", "scale=in_color_matrix=bt709:in_range=tv,format=rgb24", "-f", "rawvideo", "-"]
    command = ["ffmpeg", "-v", "error", "-i", str(target), *shown]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    decoded = np.frombuffer(raw, np.uint8).reshape(len(colours), 48, 64, 3)
    found = decoded.reshape(len(colours), -1, 3)
    np.testing.assert_allclose(found - colours[:, None].astype(int), 0, atol=4)


def test_an_animation_has_the_frames_and_the_header_of_the_first(tmp_path):
    """Oracle: Pillow's decoder; lossy WebP is near for one colour."""
    from PIL import Image

    names = [tmp_path / f"a.{frame}.png" for frame in (1, 2)]
    for frame, name in enumerate(names, start=1):
        entries = {"usdsplat:frame": float(frame), "usdsplat:stage": "shot"}
        space = "srgb_rec709_display"
        layout = ImageLayout(resolution=(8, 6), color_space=space, metadata=entries)
        with open_writer(name, layout) as writer:
            writer.write_band(0, {"color": np.full((6, 8, 4), frame / 2, np.float32)})
    target = tmp_path / "a.webp"
    assert save_animation(names, target, rate=25.0) == target
    with Image.open(target) as moving:
        assert (moving.n_frames, moving.size) == (2, (8, 6))
        entries = moving.getexif()
        moving.load()
        assert moving.info["duration"] == 40
    assert entries[SOFTWARE] == WRITER
    told = json.loads(entries[DESCRIPTION])
    assert told["usdsplat:stage"] == "shot"
    assert json.loads(told["usdsplat:frame"]) == 1.0
