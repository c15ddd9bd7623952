"""`usdsplat info --plot`: a page with pictures and histograms."""

from __future__ import annotations

import io
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.cli.conftest import ball
from usdsplat import formats, schema
from usdsplat.core import axes
from usdsplat.core.cloud import SplatCloud
from usdsplat.products.report.charts import BARS, histogram
from usdsplat.products.report.values import round_down
from usdsplat.products.report.views import SIDE, views

COLORS = np.eye(3)
"""Red is to the right, green above, blue towards who looks from the front."""


def jack() -> SplatCloud:
    """Three balls on the axes right, up and back, and many dark ones in the middle."""
    rng = np.random.default_rng(0)
    n = 200
    positions = np.concatenate([np.repeat(np.eye(3), 20, axis=0), rng.normal(0, 0.05, (n, 3))])
    colors = np.concatenate([np.repeat(COLORS, 20, axis=0), np.zeros((n, 3))])
    return SplatCloud(
        positions=positions.astype(np.float32),
        scales=np.full((n + 60, 3), 0.02, np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n + 60, 1)),
        opacities=np.full(n + 60, 0.95, np.float32),
        sh=((colors[:, None] - 0.5) / 0.28209479).astype(np.float32),
    )


def middle(pixels: np.ndarray, channel: int) -> tuple[float, float]:
    """Where a colour is in a picture, right and up of its middle, -1 to 1."""
    others = np.delete(pixels.astype(float), channel, axis=2).max(axis=2)
    weight = np.maximum(pixels[..., channel] - others - 60, 0)
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    x, y = (float((weight * at).sum() / weight.sum()) for at in (columns, rows))
    return 2 * x / SIDE - 1, 1 - 2 * y / SIDE


@pytest.mark.parametrize(("up_axis", "frame"), [("Y", "rub"), ("Z", "rfu")])
def test_pictures_show_the_sides_that_they_are_named_after(up_axis: str, frame: str) -> None:
    """Oracle: where right, up and back are on each side of a thing, by words."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, up_axis)
    cloud = jack()
    turn = axes.change("rub", frame).astype(np.float32)
    schema.author(stage, "/Jack", replace(cloud, positions=cloud.positions @ turn.T))
    front, right, top = views(stage, None, frame)
    where = {
        side.title.partition(":")[0]: [middle(side.pixels, channel) for channel in range(3)]
        for side in (front, right, top)
    }
    unit = 2 * front.bar / float(front.bar_text)  # of the world, where the picture is 2 wide
    for side, one, other, expected in (
        ("front", 0, 1, (1, -1)),
        ("right", 2, 1, (-1, -1)),
        ("top", 0, 2, (1, 1)),
    ):
        apart = np.subtract(where[side][one], where[side][other])
        np.testing.assert_allclose(apart, np.multiply(expected, unit), atol=0.01, err_msg=side)
    names = {"rub": ("x right, y up", "-z right, y up", "x right, -z up")}
    names["rfu"] = ("x right, z up", "y right, z up", "x right, y up")
    assert [side.title.partition(": ")[2] for side in (front, right, top)] == list(names[frame])


def test_bars_count_what_they_say() -> None:
    """Oracle: NumPy, and numbers that were laid out by hand."""
    even = histogram("a", np.linspace(0, 1, 60_001), limits=(0.0, 1.0))
    assert even.counts.sum() == 60_001 and abs(even.counts - 1000).max() <= 1
    assert [text for _, text in even.ticks()] == ["0", "0.5", "1"]
    powers = histogram("b", 10.0 ** np.linspace(-3, 1, 4001), logarithmic=True)
    assert powers.counts.sum() == 4001 and len(powers.counts) == BARS
    assert powers.median == pytest.approx(0.1)
    assert powers.place(0.1) == pytest.approx(0.5, abs=1e-3)
    odd = histogram("c", np.array([0.0, np.nan, np.inf, -1, 2, 2]), logarithmic=True)
    assert (odd.counts.sum(), odd.beyond, odd.median) == (2, 4, 2)
    assert histogram("d", np.array([0.0]), logarithmic=True) is None
    same = histogram("e", np.full(9, 3.0))
    assert same.counts.sum() == 9 and same.edges[0] < 3 < same.edges[-1]
    outlier = histogram("f", np.append(np.linspace(0, 1, 9999), 1e9))
    assert outlier.edges[-1] < 1.1 and outlier.counts.sum() == 10_000


def test_round_numbers() -> None:
    """Oracle: by hand."""
    assert [round_down(x) for x in (1, 1.9, 2, 4.99, 5, 0.03)] == [1, 1, 2, 2, 5, 0.02]


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
    assert text.count("<svg") == 4
    assert "/World/Ball" in text and "/World/Ball" in out


def test_names_cannot_write_into_the_page(run, tmp_path, compiled) -> None:
    """Oracle: HTML's own escapes."""
    path = tmp_path / "<script>alert(1)<&.ply"
    formats.write(ball(20), path)
    assert run("info", path, "--plot", tmp_path / "a.html")[0] == 0
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<script" not in text and "&lt;script&gt;alert(1)&lt;&amp;.ply" in text


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
