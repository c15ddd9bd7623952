"""Tests of `usdsplat info --plot`: a page with pictures and histograms."""

from __future__ import annotations

import io
import re
import sys
import warnings
from base64 import b64decode
from xml.etree import ElementTree

import numpy as np
import pytest
from pxr import Usd

from tests.cli.conftest import ball
from usdsplat import formats
from usdsplat.products.report.views import SIDE


def test_a_page_of_a_capture_is_a_picture(run, run_json, capture, tmp_path, compiled) -> None:
    """Oracle: Pillow reads it; what is said on stdout is what is said without it."""
    plot = tmp_path / "page.png"
    assert run_json("info", capture, "--plot", plot) == run_json("info", capture)
    from PIL import Image

    with Image.open(plot) as image:
        pixels = np.asarray(image.convert("RGB"))
    assert pixels.shape[1] == 3 * SIDE + 4 * 24 and pixels.shape[0] > SIDE
    front = pixels[74 : 74 + SIDE, 24 : 24 + SIDE]
    assert (front[SIDE // 2, SIDE // 2] != front[2, 2]).any()  # the ball before the background
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.ply", "page.png"]


def test_a_page_of_a_stage_needs_no_other_file(run, shot, tmp_path, compiled) -> None:
    """Oracle: a browser's own rules: nothing in the page names another place."""
    from PIL import Image

    plot = tmp_path / "page.HTML"
    status, out, _ = run("info", shot, "--frame", "2", "--plot", plot)
    assert status == 0
    text = plot.read_text(encoding="utf-8")
    assert not re.search(r"https?:|//|src=\"(?!data:)|href=", re.sub(r"base64,[^\"]+", "", text))
    found = re.findall(r"data:image/png;base64,([^\"]+)", text)
    assert len(found) == 3
    for data in found:
        assert Image.open(io.BytesIO(b64decode(data))).size == (SIDE, SIDE)
    charts = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", text)
    assert len(charts) == 4
    for data, name in zip(charts, ("scale", "opacity", "anisotropy", "brightness"), strict=True):
        drawn = ElementTree.fromstring(b64decode(data))
        assert any(name in (each.text or "") for each in drawn.iter() if each.tag.endswith("text"))
    assert "/World/Ball" in text and "/World/Ball" in out


def test_names_cannot_write_into_the_page(run, tmp_path, compiled) -> None:
    """Oracle: HTML's own escapes."""
    path = tmp_path / "<script>alert(1)<&.ply"
    formats.write(ball(20), path)
    assert run("info", path, "--plot", tmp_path / "a.html")[0] == 0
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<script" not in text and "&lt;script&gt;alert(1)&lt;&amp;.ply" in text


@pytest.mark.parametrize("suffix", [".png", ".html"])
def test_any_name_is_drawn_as_it_is(run, tmp_path, suffix, compiled) -> None:
    """Oracle: no word on stderr about formulas, or about characters that a font lacks."""
    path = tmp_path / "$\\frac{ 日本.ply"
    formats.write(ball(20), path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status, _, err = run("info", path, "--plot", tmp_path / f"a{suffix}")
    assert (status, err) == (0, "")


@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("suffix", [".png", ".html"])
def test_a_page_of_next_to_nothing_is_a_page(run, tmp_path, count, suffix, compiled) -> None:
    """Oracle: a person's expectation."""
    formats.write(ball(count), tmp_path / "few.ply")
    status, _, _ = run("info", tmp_path / "few.ply", "--plot", tmp_path / f"a{suffix}")
    assert status == 0 and (tmp_path / f"a{suffix}").stat().st_size > 500


def test_a_stage_whose_field_cannot_be_read_has_a_page_that_says_so(run, tmp_path) -> None:
    """Oracle: the packed prim without its arrays that is authored here."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    stage.DefinePrim("/Bad", "ParticleFieldPackedSplat")
    stage.Save()
    assert run("info", tmp_path / "a.usda", "--plot", tmp_path / "a.html")[0] == 0
    assert "/Bad" in (tmp_path / "a.html").read_text(encoding="utf-8")


def test_a_page_without_matplotlib_is_refused_with_the_command_that_installs_it(
    run, capture, tmp_path, monkeypatch
) -> None:
    """Oracle: the extra of pyproject.toml; the description itself needs no matplotlib."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    status, out, err = run("info", capture, "--plot", tmp_path / "a.html")
    expected = "usdsplat: --plot: found no matplotlib, expected pip install 'usdsplat[plots]'\n"
    assert (status, out, err) == (2, "", expected)
    assert not (tmp_path / "a.html").exists()
    assert run("info", capture)[0] == 0


def test_a_page_that_cannot_be_is_refused_before_any_work(run, capture, tmp_path) -> None:
    """Oracle: a person's expectation; the capture is as it was."""
    before = capture.read_bytes()
    for plot, said in (
        (tmp_path / "a.gif", "--plot: found suffix '.gif', expected one of .png, .html"),
        (tmp_path / "none" / "a.png", "expected an existing folder"),
    ):
        status, out, err = run("info", capture, "--plot", plot)
        assert (status, out) == (2, "") and said in err and err.count("\n") == 1
    link = tmp_path / "a.png"
    link.hardlink_to(capture)
    status, _, err = run("info", capture, "--plot", link)
    assert status == 2 and "being described" in err
    assert capture.read_bytes() == before
