"""The page of measurements: what it shows is there, and what is not there is not shown."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from rich.table import Table

from benchmarks import performance, plot
from benchmarks.report import Report, Results, read_results, spread


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """A file as a benchmark writes it, read back."""
    path = tmp_path / "speed.json"
    with Report("speed", ["--json", str(path), "7"]) as report:
        assert report.arguments == ["7"]
        table = Table(title="[b]times[/b]")
        for name in ("what", "ms"):
            table.add_column(name)
        table.add_row("a|b", "1–3")
        report.show(table)
        report.say("Quiet.")
        for splats, ms in ((100_000, 10.0), (1_000_000, 100.0)):
            report.add(
                device="cpu", scene="garden", splats=splats, visible=splats, **spread([ms] * 3)
            )
    return read_results(path)


def test_results_come_back_as_they_were_written(results: Results) -> None:
    """Oracle: what was added and shown."""
    assert results.tables == [
        {"title": "times", "columns": ["what", "ms"], "rows": [["a|b", "1–3"]]}
    ]
    assert [row["ms"] for row in results.rows] == [10.0, 100.0]
    assert "numpy" in results.machine.versions


def test_a_section_without_results_is_left_out_with_all_below_it(
    results: Results, tmp_path: Path
) -> None:
    """Oracle: the page that was written by hand."""
    text = (
        "# Page\n\nWords.\n\n## Here\n\n<!-- results: speed -->\n\n## Not here\n\n"
        "<!-- results: other -->\n\n### Below\n\nWords.\n\n## Last\n\nWords.\n"
    )
    found = performance.page(text, {"speed": results}, tmp_path)
    assert found == (
        f"# Page\n\nWords.\n\n## Here\n\n*{results.machine.line}*\n\n**times**\n\n"
        "| what | ms |\n| --- | ---: |\n| a\\|b | 1–3 |\n\nQuiet.\n\n## Last\n\nWords.\n"
    )


def test_a_plot_is_drawn_of_the_results_that_are_there(results: Results, tmp_path: Path) -> None:
    """Oracle: points a decade apart are as far apart as the grid's lines."""
    text = "# Page\n\n<!-- plot: a.svg of speed with other -->\n"
    found = performance.page(text, {"speed": results}, tmp_path)
    assert found == "# Page\n\n![Milliseconds of a picture over its splats](a.svg)\n"
    drawn = (tmp_path / "a.svg").read_text()
    assert f'points="0.0,{plot.HEIGHT:.1f} {plot.WIDTH:.1f},0.0"' in drawn


def test_a_scene_alone_is_drawn_only_for_who_has_no_line() -> None:
    """Oracle: rows that were chosen by hand; another size and harmonics are not drawn either."""

    def row(device: str, scene: str, splats: int, **more: Any) -> dict[str, Any]:
        return {"device": device, "scene": scene, "splats": splats, "visible": 9, "ms": 1.0} | more

    rows = [
        row("cpu", "garden 1×1", 10),
        row("cpu", "garden 3×3", 90),
        row("cpu", "statue", 50),
        row("peer", "statue", 50),
        row("cpu", "garden 7×7", 490, size="3840x2160"),
        row("cpu", "garden 7×7", 490, sh=3),
        {"device": "cpu", "scene": "grow", "splats": 5, "ms": 1.0},
    ]
    found = [(line.device, line.kind, len(line.points)) for line in plot.lines_of(rows)]
    assert found == [("cpu", "garden", 2), ("peer", "statue", 1)]


def test_decades_are_equally_long() -> None:
    """Oracle: the logarithm."""
    axis = plot.Axis.of((0.3, 42.0), 300.0)
    assert axis.ticks == [0.1, 1.0, 10.0, 100.0]
    assert [axis.at(tick) for tick in axis.ticks] == pytest.approx([0, 100, 200, 300])
    assert axis.at(math.sqrt(10)) == pytest.approx(150)


@pytest.mark.parametrize(
    ("scene", "kind"),
    [
        ("garden 3×3", "garden"),
        ("garden 7x7", "garden"),
        ("tiled", "tiled"),
        ("tiled 0.3 M", "tiled"),
        ("visible constant", "visible constant"),
    ],
)
def test_scenes_that_differ_in_size_are_one_kind(scene: str, kind: str) -> None:
    """Oracle: names as the benchmarks use them."""
    assert plot.kind_of(scene) == kind


def test_the_page_is_that_of_the_text_and_the_results(tmp_path: Path) -> None:
    """Oracle: written again, it is the same, and so are its plots."""
    text = performance.TEXT.read_text(encoding="utf-8")
    again = performance.page(text, performance.all_results(), tmp_path)
    assert again == performance.PAGE.read_text(encoding="utf-8")
    for drawn in tmp_path.glob("*.svg"):
        kept = performance.PAGE.with_name(drawn.name)
        assert drawn.read_text(encoding="utf-8") == kept.read_text(encoding="utf-8")


def test_every_result_that_is_kept_is_shown() -> None:
    """Oracle: the names in the text."""
    text = performance.TEXT.read_text(encoding="utf-8")
    for name in performance.all_results():
        assert f"results: {name} -->" in text, name
