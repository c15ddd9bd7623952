"""Tests that schema/simulation.usda is generated from the current parameters."""

from __future__ import annotations

from usdsplat.sim import schema_source


def test_the_committed_file_is_up_to_date() -> None:
    """Oracle: the generator, run again."""
    assert schema_source.TARGET.read_text(encoding="utf-8") == schema_source.source()


def test_check_says_what_is_stale_and_writes_nothing(tmp_path, monkeypatch, capsys) -> None:
    """Oracle: a stale file; the status is that of a failing check."""
    target = tmp_path / "simulation.usda"
    target.write_text("#usda 1.0\n", encoding="utf-8")
    monkeypatch.setattr(schema_source, "TARGET", target)
    assert schema_source.main(["--check"]) == 1
    assert capsys.readouterr().out == f"{target}: stale\n"
    assert target.read_text(encoding="utf-8") == "#usda 1.0\n"
    assert schema_source.main([]) == 0
    assert schema_source.main(["--check"]) == 0


def test_no_line_is_longer_than_the_projects() -> None:
    """Oracle: the limit of 100."""
    assert max(map(len, schema_source.source().splitlines())) <= 100
