"""Tests of splat trees on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import OpenImageIO as oiio
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.delegate.stages import add_camera
from tests.schema.clouds import cloud
from tests.trees import changed, little_tree
from usdsplat import formats
from usdsplat.cli.main import main


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A stage with a tree of 200 splats."""
    return little_tree(tmp_path, cloud(n=200, degree=1))


def test_info_prints_a_line_for_each_level(tree: Path, capsys: pytest.CaptureFixture) -> None:
    """Oracle: counts by hand: 199 in leaves and a resident, a quarter, and a quarter of that."""
    assert main(["info", str(tree)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "levels level 0 nodes 4 splats 200 error 0" in lines
    assert "levels level 1 nodes 2 splats 51 error 0.1" in lines
    assert "levels level 2 nodes 1 splats 14 error 0.2" in lines
    assert "chunks 3" in lines and "splats 200" in lines


def test_info_says_what_a_view_loads(tree: Path, capsys: pytest.CaptureFixture) -> None:
    """Oracle: the counts of the levels; 23 numbers of 4 bytes for each splat of degree 1."""
    with_cameras(tree)
    for flags, splats in ((["--camera", "At"], 200), (["--lod-error", "1000"], 14)):
        assert main(["info", str(tree), "--json", *flags]) == 0
        view = json.loads(capsys.readouterr().out)["views"][0]
        assert (view["camera"], view["splats"]) == ("/tree/At", splats)
        assert view["bytes"] == 4 * 23 * splats
    assert main(["info", str(tree), "--camera", "At"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert {"camera /tree/At", "resolution 1920 1080", "lod error 1"} < set(lines)
    assert main(["info", str(tree), "--camera", "At", "--resolution", "64x48", "--json"]) == 0
    few = json.loads(capsys.readouterr().out)["views"][0]
    assert few["resolution"] == [64, 48] and few["splats"] < 200  # larger pixels, the same error
    assert main(["info", str(tree), "--camera", "At", "--resolution", "64"]) == 2
    assert "--resolution: found '64', expected two numbers of pixels" in capsys.readouterr().err
    assert main(["info", str(tree), "--camera", "No"]) == 2
    said = "--camera: found 'No', expected one of /tree/At, /tree/Away"
    assert said in capsys.readouterr().err


def test_a_capture_has_no_view(capture: Path, capsys: pytest.CaptureFixture) -> None:
    """Oracle: the flags that have no effect."""
    for flag, value in (("--camera", "At"), ("--lod-error", "2"), ("--resolution", "64x48")):
        assert main(["info", str(capture), flag, value]) == 2
        assert f"{flag}: found a capture, {capture}, expected a stage" in capsys.readouterr().err


def test_a_moved_folder_is_one_sentence_of_each_command(
    tree: Path, capsys: pytest.CaptureFixture
) -> None:
    """Oracle: a folder that was moved; the sentence names it."""
    (tree.parent / "tree_chunks").rename(tree.parent / "old")
    said = "found none of 3 chunks, without 0000.usdc in ./tree_chunks, expected the layers"
    assert main(["validate", str(tree)]) == 1
    out = capsys.readouterr().out
    assert out.count("[missing-chunk]") == 1 and said in out
    assert main(["info", str(tree)]) == 0
    printed = capsys.readouterr()
    assert printed.err.count("[missing-chunk]") == 1 and said in printed.err
    assert "chunks missing     3" in printed.out


def test_an_intact_tree_has_no_finding(tree: Path, capsys: pytest.CaptureFixture) -> None:
    """Oracle: the picture, which is not empty. Its first rows are, with several samples a pixel."""
    stage = Usd.Stage.Open(str(tree))
    add_camera(stage, "/tree/Far", eye=(0.0, 0.0, 40.0))
    stage.Save()
    picture = tree.with_name("a.exr")
    command = ["render", str(tree), "-o", str(picture), "--resolution", "160x120", "--strict"]
    assert main([*command, "--camera", "Far", "--lod-error", "8"]) == 0
    pixels = oiio.ImageBuf(str(picture)).get_pixels()
    assert pixels[..., 3].max() > 0.5 and not pixels[0, :, 3].any()
    assert main(["validate", str(tree)]) == 0
    assert "nothing-to-draw" not in "".join(capsys.readouterr())


def test_a_damaged_chunk_is_one_finding_of_render(
    tree: Path, capsys: pytest.CaptureFixture
) -> None:
    """Oracle: a file that was cut off; under --strict nothing is written."""
    chunk = tree.parent / "tree_chunks" / "0002.usdc"
    chunk.write_bytes(chunk.read_bytes()[:900])
    picture = tree.with_name("a.png")
    command = ["render", str(tree), "-o", str(picture), "--resolution", "64x48", "--lod-error", "0"]
    assert main([*command, "--strict"]) == 1
    assert not picture.exists()
    assert capsys.readouterr().err.count("[broken-chunk]") == 1
    assert main(command) == 0
    assert picture.exists()
    said = capsys.readouterr().err
    assert said.count("[broken-chunk]") == 1 and str(chunk) in said


def test_a_broken_table_has_the_same_code_everywhere(
    tree: Path, capsys: pytest.CaptureFixture
) -> None:
    """Oracle: cyclic children."""
    changed(tree, "splat:nodeFirstChild", Vt.IntArray([1, 0, 5, 0, 0, 0, 0]))
    said = "found node 1 with wrong children, expected nodes breadth first"
    assert main(["validate", str(tree)]) == 1
    out = capsys.readouterr().out
    assert out.count("[broken-tree]") == 1 and said in out
    assert main(["info", str(tree)]) == 0
    printed = capsys.readouterr()
    assert printed.err.count("[broken-tree]") == 1 and said in printed.err
    assert said in printed.out


def test_validate_counts_trees(tree: Path, capsys: pytest.CaptureFixture) -> None:
    """Oracle: one tree, and no finding about it."""
    assert main(["validate", str(tree), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["looked_at"]["trees"] == 1
    assert not [each for each in told["findings"] if "tree" in each["code"]]


def test_a_bomb_in_a_stage_is_one_finding(tree: Path, capsys: pytest.CaptureFixture) -> None:
    """Oracle: the length of the array that was authored, in a file of 100 kB."""
    crate = tree.with_suffix(".usdc")
    Sdf.Layer.FindOrOpen(str(tree)).Export(str(crate))
    changed(crate, "splat:nodeResidents", Vt.Int64Array(20_000_000))
    assert crate.stat().st_size < 100_000
    assert main(["validate", str(crate)]) == 1
    assert "found an array of 20000000 numbers" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "splats"), [([], 200), (["--lod", "1"], 51), (["--max-splats", "20"], 14)]
)
def test_convert_writes_a_level_or_a_number_of_splats(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture, flags: list[str], splats: int
) -> None:
    """Oracle: the counts of the levels, and the file read back."""
    assert main(["convert", str(tree), str(tmp_path / "out.ply"), "--json", *flags]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["splats"] == splats == len(formats.read(tmp_path / "out.ply").cloud)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--max-splats", "0"], "--max-splats: found 0, expected at least 1"),
        (["--lod", "-1"], "--lod: found -1, expected a level"),
        (["--lod", "3"], "level of detail: found level 3, expected 0 to 2"),
        (["--lod", "1", "--max-splats", "9"], "found --lod and --max-splats, expected one of them"),
    ],
)
def test_invalid_levels_are_one_sentence(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture, words: list[str], said: str
) -> None:
    """Oracle: the contract of errors; nothing is written."""
    assert main(["convert", str(tree), str(tmp_path / "out.ply"), *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out.ply").exists()


def with_cameras(tree: Path) -> None:
    """Cameras in front of a tree: one that looks at it, one that looks away."""
    layer = Sdf.Layer.FindOrOpen(str(tree))
    stage = Usd.Stage.Open(layer)
    for name, turn in (("At", 0), ("Away", 180)):
        camera = UsdGeom.Camera.Define(stage, f"/tree/{name}")
        camera.AddTranslateOp().Set((0, 0, 60))
        camera.AddRotateYOp().Set(turn)
    layer.Save()


@pytest.mark.parametrize(
    ("flags", "splats"),
    [
        (["--camera", "At", "--lod-error", "0"], 200),
        (["--camera", "/tree/Away", "--lod-error", "0"], 14),
        (["--camera", "At", "--lod-error", "1000"], 14),
        (["--camera", "At", "--lod-error", "0", "--splat-budget", "60"], 51),
        (["--camera", "At", "--lod-error", "50", "--resolution", "8x6"], 14),
    ],
)
def test_convert_writes_the_cut_of_a_camera(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture, flags: list[str], splats: int
) -> None:
    """Oracle: the counts of the levels: all leaves in view, the root out of view or from afar."""
    with_cameras(tree)
    assert main(["convert", str(tree), str(tmp_path / "out.ply"), "--json", *flags]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["splats"] == splats == len(formats.read(tmp_path / "out.ply").cloud)


def test_convert_writes_the_cut_of_each_frame(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Oracle: the file that is written for each frame alone, and the counts of the levels: the
    camera moves away from a tree with 200 leaves and a root of 14 splats."""
    stage = Usd.Stage.Open(str(tree))
    place = UsdGeom.Camera.Define(stage, "/tree/Cam").AddTranslateOp()
    for frame, z in ((1, 10), (2, 200), (3, 9000)):
        place.Set((0, 0, z), frame)
    stage.Save()
    flags = ["--camera", "Cam", "--resolution", "640x480", "--splat-budget", "150", "-v"]
    words = [
        "convert",
        str(tree),
        str(tmp_path / "a.####.ply"),
        "--frames",
        "1-3",
        "--json",
        *flags,
    ]
    assert main(words) == 0
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    assert (told["frames"], len(set(told["counts"]))) == ([1, 2, 3], 3)
    assert told["counts"][0] <= 150 and told["counts"][2] == 14 and told["findings"] == []
    for frame in (1, 2, 3):
        alone = tmp_path / "alone.ply"
        assert main(["convert", str(tree), str(alone), "--frame", str(frame), *flags]) == 0
        assert (tmp_path / f"a.{frame:04}.ply").read_bytes() == alone.read_bytes()
    assert main([*words[:-2], "9", "--strict"]) == 1
    assert capsys.readouterr().err.count("[small-budget]") == 1
    assert main(["convert", str(tree), str(tmp_path / "b.####.ply"), *flags]) == 2
    assert "found no frames, expected a stage with a range" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--lod-error", "2"], "--lod-error: found no --camera, expected the camera of the view"),
        (["--camera", "At", "--lod", "1"], "--camera: found --lod too, expected one of them"),
        (["--camera", "No"], "--camera: found 'No', expected one of /tree/At, /tree/Away"),
        (["--camera", "At", "--lod-error", "-1"], "--lod-error: found -1.0, expected 0 to 1000"),
        (["--camera", "At", "--resolution", "9"], "--resolution: found '9', expected two numbers"),
        (["--camera", "At", "{}/tree.usda"], "--camera: found 2 inputs, expected one stage"),
    ],
)
def test_invalid_views_are_one_sentence(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture, words: list[str], said: str
) -> None:
    """Oracle: the contract of errors; nothing is written."""
    with_cameras(tree)
    words = [word.format(tmp_path) for word in words]
    assert main(["convert", str(tree), *words, str(tmp_path / "out.ply")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out.ply").exists()


def test_max_splats_needs_a_stage(
    tmp_path: Path, capture: Path, capsys: pytest.CaptureFixture
) -> None:
    """Oracle: the flags that have no effect."""
    words = ["convert", str(capture), str(tmp_path / "out.spz"), "--max-splats", "9"]
    assert main(words) == 2
    assert "--max-splats: found it with a capture that becomes a capture" in capsys.readouterr().err
