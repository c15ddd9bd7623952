"""Write docs/performance.md and its plot, from its text and the stored results.

    python -m benchmarks.performance

The text is `performance.md` beside this file. A line `<!-- results: NAME -->` in it is replaced by
the machine and the tables of `results/NAME.json`. `<!-- plot: FILE.svg of NAME NAME with NAME -->`
is replaced by a plot of those results that exist; one of those before `with` must exist. A section,
from one heading to the next, is left out together with its subsections if its results are missing.
To include it, add the file and run this script.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from benchmarks.plot import draw, lines_of
from benchmarks.report import Results, Row, read_results

TEXT = Path(__file__).with_name("performance.md")
RESULTS = Path(__file__).with_name("results")
PAGE = Path(__file__).parents[1] / "docs" / "performance.md"

_HEADING = re.compile(r"^(#+) .*$", re.MULTILINE)
_RESULTS = re.compile(r"^<!-- results: (\S+) -->$", re.MULTILINE)
_PLOT = re.compile(r"^<!-- plot: (\S+) of (.+?)(?: with (.+))? -->$", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A heading with the text up to the next one."""

    level: int
    text: str


def sections_of(text: str) -> list[Section]:
    """Return the sections of a text, which begins with a heading."""
    found = list(_HEADING.finditer(text))
    ends = [heading.start() for heading in found[1:]] + [len(text)]
    return [
        Section(level=len(heading[1]), text=text[heading.start() : end])
        for heading, end in zip(found, ends, strict=True)
    ]


def is_complete(section: Section, results: dict[str, Results]) -> bool:
    """Return whether all results of a section exist; for a plot, one of its main results is
    enough."""
    plots = [names.split() for _, names, _ in _PLOT.findall(section.text)]
    return all(name in results for name in _RESULTS.findall(section.text)) and all(
        any(name in results for name in names) for names in plots
    )


def markdown(results: Results) -> str:
    """Return machine, tables and sentences of results as Markdown."""
    parts = [f"*{results.machine.line}*", *map(_table, results.tables), *results.notes]
    return "\n\n".join(parts)


def _table(table: Row) -> str:
    lines = [table["columns"], ["---", *["---:"] * (len(table["columns"]) - 1)], *table["rows"]]
    rows = [
        "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |"
        for line in lines
    ]
    return "\n".join([f"**{table['title']}**", "", *rows] if table["title"] else rows)


def page(text: str, results: dict[str, Results], folder: Path) -> str:
    """Return the page, and write its plots to `folder`."""

    def plotted(match: re.Match[str]) -> str:
        name, sources = match[1], f"{match[2]} {match[3] or ''}".split()
        rows = [row for source in sources if source in results for row in results[source].rows]
        draw(lines_of(rows), folder / name)
        return f"![Milliseconds of a picture over its splats]({name})"

    parts, missing = [], 0
    for section in sections_of(text):
        if missing and section.level > missing:
            continue
        missing = 0 if is_complete(section, results) else section.level
        if not missing:
            filled = _RESULTS.sub(lambda match: markdown(results[match[1]]), section.text)
            parts.append(_PLOT.sub(plotted, filled))
    return "".join(parts)


def all_results() -> dict[str, Results]:
    """Return the stored results by name."""
    return {path.stem: read_results(path) for path in sorted(RESULTS.glob("*.json"))}


def main() -> None:
    """Write the page."""
    text = TEXT.read_text(encoding="utf-8")
    PAGE.write_text(page(text, all_results(), PAGE.parent), encoding="utf-8")


if __name__ == "__main__":
    main()
