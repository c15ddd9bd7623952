"""Tests that docs/reference/findings.md is generated from the current codes."""

from __future__ import annotations

from usdsplat.core import findings_page


def test_the_committed_page_is_up_to_date() -> None:
    """Oracle: the generator, run again."""
    assert findings_page.TARGET.read_text(encoding="utf-8") == findings_page.page()


def test_check_says_whether_a_page_is_stale(tmp_path, monkeypatch) -> None:
    """Oracle: a page with other text, then the written one."""
    target = tmp_path / "reference" / "findings.md"
    monkeypatch.setattr(findings_page, "TARGET", target)
    assert findings_page.main([]) == 0
    assert findings_page.main(["--check"]) == 0
    target.write_text("# Findings\n", encoding="utf-8")
    assert findings_page.main(["--check"]) == 1
