"""Tests of the date of files that are the same in each run."""

from __future__ import annotations

import pytest

from usdsplat.core.source_date import source_date


@pytest.mark.parametrize(
    ("text", "expected"),
    [(None, None), ("", None), ("soon", None), ("-1", None), ("0", 0), ("1700000000", 1700000000)],
)
def test_the_date_is_a_count_of_seconds(
    monkeypatch: pytest.MonkeyPatch, text: str | None, expected: int | None
) -> None:
    """Oracle: the number in the text; anything else is no date."""
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    if text is not None:
        monkeypatch.setenv("SOURCE_DATE_EPOCH", text)
    assert source_date() == expected
