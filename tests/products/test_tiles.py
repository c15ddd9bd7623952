"""Tests of pictures in tiles: joined, they are the picture that is drawn at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.cli.conftest import ball
from tests.core.test_output import ended_process, left_folder
from usdsplat import formats
from usdsplat.core.errors import UsageError
from usdsplat.products.tiles import TileStep, Tiling

pytestmark = pytest.mark.usefixtures("compiled")
SIZE = ("--resolution", "61x43", "--device", "cpu", "-q")
DATES = {"DateTime", "capDate"}


def content(path):
    """Names, pixels and headers of all parts of a picture, without dates."""
    file, found = oiio.ImageInput.open(str(path)), []
    while file.seek_subimage(len(found), 0):
        spec = file.spec()
        header = {each.name: str(each.value) for each in spec.extra_attribs}
        if spec.deep:
            data = file.read_native_deep_image()
            counts = np.array([data.samples(i) for i in range(data.pixels)])
            values = [
                data.deep_value_uint(i, c, s) if data.channeltype(c) == "uint" else
                data.deep_value(i, c, s)
                for i in range(data.pixels) for c in range(data.channels)
                for s in range(data.samples(i))
            ]  # fmt: skip
            pixels = (counts.tobytes(), np.array(values).tobytes())
        else:
            pixels = np.ascontiguousarray(file.read_image("unknown")).tobytes()
        window = spec.x, spec.y, spec.width, spec.height, spec.full_width, spec.full_height
        kept = {name: value for name, value in header.items() if name not in DATES}
        found.append((spec.channelnames, window, kept, pixels))
    file.close()
    return found


@pytest.mark.parametrize("whole", [(0, 0, 61, 43), (-7, 3, 40, 90)])
@pytest.mark.parametrize("tiling", [Tiling(1, 1), Tiling(3, 2), Tiling(40, 43)], ids=str)
def test_tiles_cover_each_pixel_once(whole, tiling):
    """Oracle: a count of each pixel."""
    x0, y0, x1, y1 = whole
    seen = np.zeros((y1 - y0, x1 - x0), int)
    for number in range(1, len(tiling) + 1):
        left, top, right, bottom = tiling.window(number, whole)
        seen[top - y0 : bottom - y0, left - x0 : right - x0] += 1
    assert (seen == 1).all()


@pytest.mark.parametrize(
    ("name", "flags"),
    [
        ("a.exr", ("--aovs", "all", "--float", "--samples", "3")),
        ("a.exr", ("--aovs", "color,Z,id,cryptoObject", "--overscan", "5", "--multipart")),
        ("a.png", ()),
        ("a.exr", ("--deep", "--aovs", "id,cryptoObject", "--float")),
        ("a.exr", ("--deep", "--deep-color", "beauty", "--deep-error", "0.02")),
        ("a.exr", ("--crop", "10,5,50,40", "--bake-view", "--aovs", "color,albedo")),
    ],
    ids=["all", "multipart", "png", "deep", "merged", "baked"],
)
def test_joined_tiles_are_the_whole_picture(run_json, shot, tmp_path, name, flags):
    """Oracle: the picture that is drawn at once, pixels and headers but the date."""
    whole, tiled = tmp_path / name, tmp_path / "tiled" / name
    words = ("render", shot, "--frames", "2", *SIZE, *flags)
    run_json(*words, "-o", whole)
    for tile in (*range(1, 7), "join"):
        report = run_json(*words, "-o", tiled, "--tiles", "3x2", "--tile", tile)
    assert [item["path"] for item in report["pictures"]] == [str(tiled)]
    assert content(tiled) == content(whole)
    assert sorted(each.name for each in tiled.parent.iterdir()) == [name]


def test_tiles_are_kept_when_they_are_asked_for_again(run_json, run, shot, tmp_path):
    """Oracle: the files' times: with --resume, tiles of the same picture are not drawn again, those
    of another one are."""
    words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "2x1")
    run_json(*words, "--tile", "1")
    tile = TileStep(Tiling(2, 1), 1).path(tmp_path / "a.exr")
    before = tile.stat().st_mtime_ns
    assert run_json(*words, "--tile", "1", "--resume")["pictures"] == []
    assert tile.stat().st_mtime_ns == before
    assert run_json(*words, "--tile", "1", "--resume", "--samples", "2")["pictures"]
    assert tile.stat().st_mtime_ns != before


def test_tiles_that_lack_or_are_others_are_refused(run, run_json, shot, tmp_path):
    """Oracle: the sentences, and that no picture is written."""
    words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "2x1")
    run_json(*words, "--tile", "1")
    status, _, err = run(*words, "--tile", "join")
    assert status == 2 and "0002-of-2x1.tile: found no file, expected a tile that was" in err
    run_json(*words, "--tile", "2", "--samples", "2")
    status, _, err = run(*words, "--tile", "join")
    assert status == 2 and "found a tile of another picture, expected one of this picture" in err
    step = TileStep(Tiling(2, 1), 2)
    step.path(tmp_path / "a.exr").write_bytes(b"USDSPLA1 and more")
    status, _, err = run(*words, "--tile", "join")
    assert status == 2 and "found a damaged file, expected a complete one" in err
    assert not (tmp_path / "a.exr").exists()


def test_a_join_may_be_repeated_where_it_keeps_the_tiles(run_json, shot, tmp_path):
    """Oracle: the bytes of the picture. An engine that loses a worker repeats what it did."""
    words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "2x1")
    for tile in ("1", "2"):
        run_json(*words, "--tile", tile)
    run_json(*words, "--tile", "join", "--keep-tiles")
    before = content(tmp_path / "a.exr")
    run_json(*words, "--tile", "1")
    run_json(*words, "--tile", "join")
    assert content(tmp_path / "a.exr") == before
    assert not (tmp_path / "a.exr.tiles").exists()


def test_a_join_that_lacks_a_tile_leaves_the_picture_and_the_other_tiles(
    run, run_json, shot, tmp_path
):
    """Oracle: the bytes of the earlier picture, which may have been of other settings."""
    words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "2x1")
    for tile in ("1", "2", "join"):
        run_json(*words, "--tile", tile)
    before = (tmp_path / "a.exr").read_bytes()
    run_json(*words, "--tile", "1")
    status, _, err = run(*words, "--tile", "join")
    assert status == 2 and "0002-of-2x1.tile: found no file, expected a tile that was" in err
    assert (tmp_path / "a.exr").read_bytes() == before
    assert len(list((tmp_path / "a.exr.tiles").iterdir())) == 1


def test_what_a_killed_process_left_among_tiles_goes_with_them(run_json, shot, tmp_path):
    """Oracle: the listing of the folder."""
    words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "1x1")
    run_json(*words, "--tile", "1")
    left_folder(tmp_path / "a.exr.tiles", ended_process())
    run_json(*words, "--tile", "join")
    assert not (tmp_path / "a.exr.tiles").exists()


def test_tiles_that_may_not_be_removed_stay(run_json, shot, tmp_path, monkeypatch):
    """Oracle: the bytes of the picture; a farm's workers may be another user."""
    words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "1x1")
    run_json(*words, "--tile", "1")
    run_json(*words, "--tile", "join", "--keep-tiles")
    before = content(tmp_path / "a.exr")
    unlink = Path.unlink

    def refused(path, **options):
        if path.suffix == ".tile":
            raise PermissionError(13, "not yours", str(path))
        unlink(path, **options)

    monkeypatch.setattr(Path, "unlink", refused)
    run_json(*words, "--tile", "join")
    assert content(tmp_path / "a.exr") == before
    assert len(list((tmp_path / "a.exr.tiles").iterdir())) == 1


def test_tiles_of_other_captures_and_cameras_are_others(run, run_json, capture, tmp_path):
    """Oracle: the sentence: a tile depends on the splats, and on the frames that a camera fits."""
    words = ("render", capture, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, "--tiles", "2x1")
    run_json(*words, "--tile", "1")
    formats.write(ball(200, 7), capture)
    run_json(*words, "--tile", "2")
    status, _, err = run(*words, "--tile", "join")
    assert status == 2 and "a tile of another picture" in err


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--tiles", "0x2", "--tile", "1"), "--tiles: found '0x2', expected COLUMNSxROWS"),
        (("--tiles", "2x2", "--tile", "5"), "--tile: found '5', expected 1 to 4, or join"),
        (("--tiles", "2x2"), "--tiles: found 2x2, expected --tile, or --jobs, --dask or --openjd"),
        (("--tile", "1"), "--tile: found 1, expected --tiles too"),
        (("--keep-tiles",), "--keep-tiles: found it without --tile, expected --tile join"),
        (("--tiles", "62x1", "--tile", "1"), "found 62x1 tiles of 61x43 pixels"),
    ],
)
def test_bad_tiles(run, shot, tmp_path, flags, sentence):
    """Oracle: the sentences."""
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", "--frames", "1", *SIZE, *flags)
    assert status == 2 and sentence in err and not list(tmp_path.glob("a*"))


def test_a_tiling_is_limited():
    """Oracle: the error."""
    with pytest.raises(UsageError, match="each 1 to 64"):
        Tiling.parse("65x1")
