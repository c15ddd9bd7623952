"""Tests of findings and their collector."""

from __future__ import annotations

import re

import pytest

from usdsplat.core.errors import (
    FormatError,
    OutputError,
    StageError,
    StrictError,
    UnknownFormatError,
)
from usdsplat.core.finding_codes import fields, products, stages
from usdsplat.core.findings import CODES, Findings, finding, from_error


def test_no_code_has_two_meanings() -> None:
    """Oracle: the tables, of which a later one would replace what an earlier one says."""
    tables = [stages.CODES, products.CODES, fields.CODES]
    assert len(CODES) == sum(map(len, tables))


def test_a_place_is_split_into_path_and_attribute() -> None:
    """Oracle: the parts by hand; the name of something that is no prim stays whole."""
    found = finding("unused", "/World/Sim.splatSim:rd:feed", "1", "2")
    assert (found.path, found.attribute) == ("/World/Sim", "splatSim:rd:feed")
    assert found.message == "/World/Sim.splatSim:rd:feed: found 1, expected 2"
    assert finding("unused", "/World/Sim", "1", "2").attribute == ""
    assert finding("usd-message", "USD", "1", "2").path == "USD"


@pytest.mark.parametrize(
    "where",
    [
        "/shots/sq 10/plate.0001.exr",
        "/shots/plate.EXR",
        "/a-b/c.usda",
        "/lib/numba/x.py:12",
        "/home/x/my shot.usda",
        "/home/x/my shot.usda frames",
        "/home/x/shot.usda frames",
    ],
)
def test_the_name_of_a_file_stays_whole(where: str) -> None:
    """Oracle: the very name, also where it could be the path of a property."""
    found = finding("assumed-space", where, "1", "2")
    assert (found.path, found.attribute) == (where, "")
    assert found.message.startswith(f"{where}: found 1")


def test_a_part_of_a_prim_is_an_attribute() -> None:
    """Oracle: the parts by hand."""
    for where, path, attribute in (
        ("/World/A color space", "/World/A", "color space"),
        ("/W/A.primvars:displayColor color space", "/W/A", "primvars:displayColor color space"),
        ("/W/A splat:grade:gain", "/W/A", "splat:grade:gain"),
    ):
        found = finding("unused", where, "1", "2")
        assert (found.path, found.attribute) == (path, attribute)


@pytest.mark.parametrize("error", [FormatError, UnknownFormatError, OutputError])
def test_a_caller_that_knows_says_that_there_is_no_attribute(error) -> None:
    """Oracle: the name of a file that looks like the path of a property."""
    where = "/data/splats.bin"
    for found in (
        finding("unreadable", where, "1", "2", attribute=""),
        from_error("unreadable", error(where, "1", "2")),
    ):
        assert (found.path, found.attribute) == (where, "")
    assert finding("unused", "/A", "1", "2", attribute="bin").message.startswith("/A.bin: found 1")
    assert from_error("unused", StageError(where, "1", "2")).attribute == "bin"


def test_severity_and_cure_are_those_of_the_code_unless_given() -> None:
    """Oracle: the table."""
    error = StageError("/A", "x", "y")
    for code, meaning in CODES.items():
        found = from_error(code, error)
        assert (found.severity, found.cure) == (meaning.severity, meaning.cure)
        assert found.told.startswith(f"{meaning.severity} [{code}] /A: found x, expected y")
    assert finding("unused", "/A", "x", "y", severity="note", cure="c").severity == "note"


def test_codes_are_words_joined_by_hyphens() -> None:
    """Oracle: a regular expression; each meaning and cure is text without a full stop."""
    for code, meaning in CODES.items():
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", code)
        assert meaning.meaning and meaning.cure
        assert not meaning.meaning.endswith(".") and not meaning.cure.endswith(".")


def test_a_finding_is_told_once_with_the_frame_where_it_begins() -> None:
    """Oracle: two findings at three frames."""
    told: list[str] = []
    findings = Findings(lambda each: told.append(each.message))
    first, later = finding("unused", "/A", "x", "y"), finding("unused", "/B", "x", "y")
    findings.extend([first])
    findings.extend([first, later], time=2.0)
    findings.extend([first, later], time=3.0)
    assert told == ["/A: found x, expected y", "/B at 2: found x, expected y"]
    assert len(findings) == 2 and findings.count("warning") == 2


@pytest.mark.parametrize(
    ("severity", "fails"), [("error", True), ("warning", True), ("note", False)]
)
def test_strict_fails_on_errors_and_warnings_but_not_on_notes(severity, fails) -> None:
    """Oracle: the definition; a lenient collector never fails."""
    found = finding("unused", "/A", "x", "y", severity=severity)
    for is_strict in (True, False):
        findings = Findings(is_strict=is_strict)
        findings.add(found)
        assert findings.is_failure == fails
        if fails and is_strict:
            with pytest.raises(StrictError, match=f"found 1 {severity}, expected none"):
                findings.check()
        else:
            findings.check()
