"""Tests of recordings, with a document that draws nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.preview.timeline import Timeline
from usdsplat.preview.values import ViewState
from usdsplat.preview.web import recording
from usdsplat.preview.web.recording import MOST_FRAMES, Recording


def test_a_range_that_is_too_long_is_refused_at_once() -> None:
    """Oracle: the limit, in a sentence."""
    timeline = Timeline(start=1.0, end=MOST_FRAMES + 1.0, rate=24.0)
    with pytest.raises(UsageError, match=f"found {MOST_FRAMES + 1} frames, expected at most"):
        Recording(ViewState(), timeline, page=None, proxy=None)  # type: ignore[arg-type]


def test_files_that_are_too_large_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the limit in bytes; a movie is sent as it is."""
    movie = tmp_path / "recording.mp4"
    movie.write_bytes(b"12345")
    found = recording._packed((movie,))
    assert found is not None and (found.name, found.data) == ("recording.mp4", b"12345")
    monkeypatch.setattr(recording, "MOST_BYTES", 4)
    with pytest.raises(UsageError, match="5 bytes"):
        recording._packed((movie,))
    assert recording._packed(()) is None
