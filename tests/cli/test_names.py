"""Tests of names of files that hold anything: bytes that are not UTF-8, newlines."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from usdsplat.schema import is_splat_field

DRAW = ("--resolution", "32x24", "--threads", "1")


@pytest.fixture
def strange(tmp_path):
    """Return a function that copies a file to a name that is not UTF-8."""

    def copied(path):
        target = tmp_path / os.fsdecode(b"bad\xff" + path.suffix.encode())
        try:
            shutil.copy(path, target)
        except OSError:
            pytest.skip("the file system takes UTF-8 only")
        return target

    return copied


def one_line(err: str) -> bool:
    """Whether nothing but remarks of one line each was said, in UTF-8."""
    err.encode("utf-8")
    return all(line.startswith("usdsplat: ") for line in err.splitlines())


def test_captures_and_stages_with_any_name_are_read(strange, capture, shot, run, tmp_path):
    """Oracle: the status and results of the same commands with plain names."""
    for source in (strange(capture), strange(shot)):
        status, out, err = run("info", source)
        assert status == 0 and one_line(err) and "bad\\xff" in out
        assert run("info", source, "--json")[0] == 0
        status, _, err = run("render", source, "-o", tmp_path / "a.exr", *DRAW)
        assert status == 0 and one_line(err)
        status, _, err = run("convert", source, tmp_path / "a.spz")
        assert (status, err) == (0, "")
    assert run("validate", strange(shot))[0] in (0, 1)


def test_a_capture_with_any_name_becomes_a_prim(strange, capture, run, tmp_path):
    """Oracle: USD opens the stage; the model is named after the file."""
    from pxr import Usd

    assert run("convert", strange(capture), tmp_path / "a.usda")[0] == 0
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    (field,) = [prim for prim in stage.Traverse() if is_splat_field(prim)]
    assert field.GetPath() == "/bad_xff/splats"
    assert field.GetCustomDataByKey("usdsplat")["source"] == "bad\\xff.ply"


def test_a_holdout_and_a_config_with_any_name_are_read(strange, shot, run, tmp_path):
    """Oracle: the status with plain names; a missing one is a sentence."""
    depth = tmp_path / "z.exr"
    assert run("render", shot, "-o", depth, "--aovs", "color,Z", *DRAW)[0] == 0
    status, _, err = run(
        "render", shot, "-o", tmp_path / "a.exr", "--holdout", strange(depth), *DRAW
    )
    assert status == 0, err
    missing = tmp_path / os.fsdecode(b"none\xff.ocio")
    words = ("--config", missing, "--color-mode", "inverseView")
    status, _, err = run("render", shot, "-o", tmp_path / "b.exr", *words, *DRAW)
    assert status == 2 and one_line(err)


def test_a_stage_that_a_layer_cannot_refer_to_is_not_baked(strange, capture, run, tmp_path):
    """Oracle: status 2, and no bake: its sublayer would be a link that is gone afterwards."""
    assert run("simulate", "--preset", "grow", capture, "-o", tmp_path / "sim.usda")[0] == 0
    source = strange(tmp_path / "sim.usda")
    status, _, err = run("simulate", source, "-o", tmp_path / "b.usda", "--frames", "1:2")
    assert status == 2 and one_line(err)
    assert "found a name that is not UTF-8" in err
    assert not (tmp_path / "b.usda").exists()


def test_a_preset_does_not_refer_to_a_link(strange, capture, run, tmp_path):
    """Oracle: status 2, and no stage: its sublayer would be a link that is gone afterwards."""
    assert run("convert", capture, tmp_path / "a.usdc")[0] == 0
    source = strange(tmp_path / "a.usdc")
    status, _, err = run("simulate", "--preset", "grow", source, "-o", tmp_path / "sim.usda")
    assert status == 2 and one_line(err)
    assert "found a name that is not UTF-8" in err
    assert not (tmp_path / "sim.usda").exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
def test_what_a_layer_refers_to_has_no_control_characters(capture, run, tmp_path):
    """Oracle: status 2, one line, and no new file; USD refuses such asset paths."""
    assert run("simulate", "--preset", "grow", capture, "-o", tmp_path / "sim.usda")[0] == 0
    for name in ("n\nl.usda", "n\nl.usdc"):
        shutil.copy(tmp_path / ("sim.usda" if name.endswith("a") else "sim_capture.usdc"),
                    tmp_path / name)  # fmt: skip
    before = sorted(os.listdir(tmp_path))
    for words in (
        ("--preset", "grow", tmp_path / "n\nl.usdc", "-o", tmp_path / "g.usda"),
        (tmp_path / "n\nl.usda", "-o", tmp_path / "b.usda", "--frames", "1:2"),
        (tmp_path / "sim.usda", "-o", tmp_path / "b\n.usda", "--frames", "1:2"),
    ):
        status, _, err = run("simulate", *words)
        assert status == 2 and one_line(err)
        assert "found a name with a control character" in err
        assert sorted(os.listdir(tmp_path)) == before


def test_text_that_is_no_name_of_a_file_is_one_sentence(shot, run, tmp_path):
    """Oracle: status 2."""
    text = os.fsdecode(b"/a\xff:b=c")
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", "--variant", text)
    assert status == 2 and one_line(err) and "\\udcff" in err


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
def test_a_newline_stays_in_the_name_and_leaves_the_sentence(shot, run, tmp_path):
    """Oracle: stdout has the bytes of the name, stderr one line per sentence."""
    target = tmp_path / "n\nl.exr"
    status, out, err = run("render", shot, "-o", target, *DRAW)
    assert (status, out) == (0, f"{target}\n")
    assert one_line(err)
    status, _, err = run("info", tmp_path / "n\nl.ply")
    assert (status, len(err.splitlines())) == (2, 1)
    assert "n\\nl.ply" in err


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
def test_stdout_has_the_bytes_of_a_name(tmp_path):
    """Oracle: the bytes that were given to another process."""
    name = tmp_path / os.fsdecode(b"bad\xff.usda")
    code = "import sys; from usdsplat.cli import console; console.say_path(sys.argv[1])"
    run = subprocess.run([sys.executable, "-c", code, name], capture_output=True, check=True)
    assert run.stdout == os.fsencode(name) + b"\n"


@pytest.mark.parametrize("flag", ["--threads", "--samples", "--tile-size"])
@pytest.mark.parametrize("text", ["99999999999999999999", "2147483648", "1" * 5000, "1e999", "nan"])
def test_whole_numbers_have_a_range(flag, text, shot, run, tmp_path):
    """Oracle: 32 bits, which is what C++ libraries hold; status 2 and one line."""
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", f"{flag}={text}")
    assert (status, len(err.splitlines())) == (2, 1)


@pytest.mark.parametrize("text", ["inf", "-inf", "nan", "1e999"])
def test_numbers_are_finite(text, shot, run, tmp_path):
    """Oracle: status 2 and one line."""
    for words in (("--frame", text), ("--pixel-aspect", text)):
        command = "info" if words[0] == "--frame" else "render"
        target = () if command == "info" else ("-o", tmp_path / "a.exr")
        status, _, err = run(command, shot, *target, f"{words[0]}={text}")
        assert (status, len(err.splitlines())) == (2, 1)
