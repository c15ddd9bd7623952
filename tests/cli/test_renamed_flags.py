"""Tests of renamed flags."""

from __future__ import annotations

import pytest

from usdsplat.cli.renamed_flags import renamed


@pytest.mark.parametrize(
    ("words", "today", "hint"),
    [
        ("a.ply b.usd --frame rub", "a.ply b.usd --axes rub", "--frame rub is now --axes rub"),
        ("a.ply --frame=RDF b.usd", "a.ply --axes=RDF b.usd", "--frame RDF is now --axes RDF"),
        ("a.usd --time 12", "a.usd --frame 12", "--time 12 is now --frame 12"),
        ("a.usd --time=1.5", "a.usd --frame=1.5", "--time 1.5 is now --frame 1.5"),
        ("a.usd --frame 12", "a.usd --frame 12", ""),
        ("a.usd --frame fur.ply", "a.usd --frame fur.ply", ""),
        ("a.usd --frames 1-3 --frame", "a.usd --frames 1-3 --frame", ""),
    ],
)
def test_old_flags_work_for_one_version_with_a_hint(capsys, words, today, hint) -> None:
    """Oracle: written down by hand."""
    assert renamed(words.split()) == today.split()
    assert capsys.readouterr().err == (f"usdsplat: {hint}\n" if hint else "")
