"""Tests of the performance page: stored results are shown, and sections without results are left
out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.table import Table

from benchmarks import performance, plot, window_latency
from benchmarks.report import Report, Results, read_results, spread

SVG = "{http://www.w3.org/2000/svg}"


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


def paths(drawn: Path) -> dict[str, np.ndarray]:
    """Lines of a plot by id, each shape (points, 2), scaled to the unit square."""
    found = {}
    for group in ElementTree.parse(drawn).iter(f"{SVG}g"):
        name = group.get("id", "")
        if not name.startswith(("splats-", "visible-")):
            continue
        path = group.find(f"{SVG}path")
        numbers = re.findall(r"[-\d.]+", path.attrib["d"]) if path is not None else []
        points = np.array(numbers, float).reshape(-1, 2)
        extent = np.ptp(points, axis=0)
        found[name] = (points - points.min(axis=0)) / np.where(extent > 0, extent, 1)
    return found


def test_a_plot_is_drawn_of_the_results_that_are_there(results: Results, tmp_path: Path) -> None:
    """Oracle: two points by hand; pixels of an SVG count downwards, so the slower one is above."""
    text = "# Page\n\n<!-- plot: a.svg of speed with other -->\n"
    found = performance.page(text, {"speed": results}, tmp_path)
    assert found == "# Page\n\n![Milliseconds of a picture over its splats](a.svg)\n"
    drawn = paths(tmp_path / "a.svg")
    assert sorted(drawn) == ["splats-0", "visible-0"]
    for line in drawn.values():
        assert line.tolist() == [[0, 1], [1, 0]]
    assert "usdsplat, CPU: garden" in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_points_lie_on_logarithmic_axes(tmp_path: Path) -> None:
    """Oracle: the logarithm: 10 lies halfway between 1 and 100, and is two thirds of 31.6."""
    rows = [
        {"device": "cpu", "scene": "garden", "splats": splats, "visible": 9, "ms": ms}
        for splats, ms in ((1, 1.0), (10, 10.0), (100, 10.0**1.5))
    ]
    plot.draw(plot.lines_of(rows), tmp_path / "a.svg")
    expected = [[0, 1], [0.5, 1 / 3], [1, 0]]
    np.testing.assert_allclose(paths(tmp_path / "a.svg")["splats-0"], expected, atol=1e-5)


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
    """Oracle: written again, it is the same, and its plots have the same lines; the layout of a
    plot depends on matplotlib's version."""
    text = performance.TEXT.read_text(encoding="utf-8")
    again = performance.page(text, performance.all_results(), tmp_path)
    assert again == performance.PAGE.read_text(encoding="utf-8")
    (drawn,) = tmp_path.glob("*.svg")
    found, kept = paths(drawn), paths(performance.PAGE.with_name(drawn.name))
    assert len(kept) > 6 and found.keys() == kept.keys()
    for name, line in found.items():
        np.testing.assert_allclose(line, kept[name], atol=0.02, err_msg=name)


def test_every_result_that_is_kept_is_shown() -> None:
    """Oracle: the names in the text."""
    text = performance.TEXT.read_text(encoding="utf-8")
    for name in performance.all_results():
        assert f"results: {name} -->" in text, name


def test_the_page_is_made_of_its_text_and_results(tmp_path: Path) -> None:
    """Oracle: the page in the repository: what is written by hand there would be lost."""
    text = performance.TEXT.read_text(encoding="utf-8")
    made = performance.page(text, performance.all_results(), tmp_path)
    assert made == performance.PAGE.read_text(encoding="utf-8")


def test_the_table_of_the_window_is_that_of_its_script() -> None:
    """Oracle: the script's own names of columns, in the stored table and in the text."""
    columns = window_latency.COLUMNS
    (table,) = performance.all_results()["cpu-window_latency"].tables
    assert table["columns"] == list(columns)
    text = performance.PAGE.read_text(encoding="utf-8")
    assert "| " + " | ".join(columns) + " |" in text
    assert all(f"*{name}*" in text for name in columns if name not in ("scene", "pictures/s"))
