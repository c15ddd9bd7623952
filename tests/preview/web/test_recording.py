"""Tests of recordings, with a document that draws nothing."""

from __future__ import annotations

import asyncio
import io
import json
import threading
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest

from usdsplat.core.cancel import Cancelled
from usdsplat.core.errors import UsageError
from usdsplat.preview.timeline import Timeline
from usdsplat.preview.values import ViewState
from usdsplat.preview.web import recording
from usdsplat.preview.web.pages import Page
from usdsplat.preview.web.recording import MOST_FRAMES, Recording
from usdsplat.preview.web.session_proxy import SessionProxy


def test_a_range_that_is_too_long_is_refused_at_once() -> None:
    """Oracle: the limit, in a sentence."""
    timeline = Timeline(start=1.0, end=MOST_FRAMES + 1.0, rate=24.0)
    with pytest.raises(UsageError, match=f"found {MOST_FRAMES + 1} frames, expected at most"):
        Recording(ViewState(), timeline, page=Page(), proxy=cast(SessionProxy, Proxy()))


class Book:
    """A flipbook of five frames, of five bytes each."""

    def __init__(self, state: ViewState, frames: list[float], path: Path, *, cancel: Any) -> None:
        self.files: tuple[Path, ...] = ()
        self._folder, self._cancel, self._count = path.parent, cancel, len(frames)

    def turn(self, document: Any) -> bool:
        try:
            self._cancel.check()
        except Cancelled:
            return False
        if len(self.files) == self._count:
            return False
        self.files = (*self.files, self._folder / f"frame.{len(self.files) + 1:04}.png")
        self.files[-1].write_bytes(b"12345")
        return True


class Proxy:
    """Runs every task at once, and counts them."""

    def __init__(self) -> None:
        self.turns = 0
        self.after: dict[int, Callable[[], None]] = {}
        """What happens after a turn, by its number."""

    def ask(self, task: Any, done: Any, failed: Any) -> None:
        self.turns += 1
        try:
            result = task(None)
        except UsageError as error:
            failed(error)
            return
        self.after.get(self.turns, lambda: None)()
        asyncio.get_running_loop().call_soon(done, result)


def recorded(
    monkeypatch: pytest.MonkeyPatch,
    after: dict[int, Callable[[Recording], None]] | None = None,
    *,
    book: type = Book,
    ffmpeg: str | None = None,
) -> tuple[Proxy, Page]:
    """Record five frames; `after` has actions by the number of turns."""
    monkeypatch.setattr(recording, "Flipbook", book)
    monkeypatch.setattr("usdsplat.preview.web.recording.shutil.which", lambda name: ffmpeg)
    proxy, page = Proxy(), Page()

    async def main() -> None:
        timeline = Timeline(start=1.0, end=5.0, rate=24.0)
        made = Recording(ViewState(), timeline, page=page, proxy=cast(SessionProxy, proxy))
        for turn, action in (after or {}).items():
            proxy.after[turn] = partial(action, made)
        while not made.is_over:
            await asyncio.sleep(0)
        assert not made._folder.exists()

    asyncio.run(main())
    return proxy, page


def news(page: Page) -> list[Any]:
    return [json.loads(each) for each in page.outbox._news.values()]


def test_frames_are_packed_in_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: zipfile reads what was written; the thread that packed is not the server's."""
    threads = []
    packed = recording._packed
    monkeypatch.setattr(
        recording,
        "_packed",
        lambda *given: threads.append(threading.current_thread()) or packed(*given),
    )
    _, page = recorded(monkeypatch)
    (download,) = page.outbox.stream._downloads
    archive = zipfile.ZipFile(io.BytesIO(download.data))
    assert [archive.read(each) for each in archive.namelist()] == [b"12345"] * 5
    assert threads[0] is not threading.main_thread()
    assert news(page) == [{"type": "recording", "content": ""}]


def test_a_recording_ends_with_the_frame_that_is_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: 5 bytes a frame and a limit of 12: the third."""
    monkeypatch.setattr(recording, "MOST_BYTES", 12)
    proxy, page = recorded(monkeypatch)
    assert proxy.turns == 3 and not page.outbox.stream._downloads
    assert "15 bytes after 3 frames" in news(page)[-1]["content"]


def test_a_movie_is_measured_while_it_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the bytes in the folder, though the flipbook names no file before the end."""

    class Growing(Book):
        def turn(self, document: Any) -> bool:
            self.files = getattr(self, "hidden", ())
            has_more = super().turn(document)
            self.hidden, self.files = self.files, ()
            return has_more

    monkeypatch.setattr(recording, "MOST_BYTES", 12)
    proxy, page = recorded(monkeypatch, book=Growing, ffmpeg="ffmpeg")
    assert proxy.turns == 3
    assert "15 bytes after 3 frames" in news(page)[-1]["content"]


def test_nothing_is_packed_for_a_page_that_has_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: no call of the packer; a page that only stops gets its frames."""
    calls = []
    packed = recording._packed
    monkeypatch.setattr(recording, "_packed", lambda *given: calls.append(1) or packed(*given))
    _, page = recorded(monkeypatch, {2: Recording.leave})
    assert not calls and not page.outbox.stream._downloads
    _, page = recorded(monkeypatch, {2: Recording.cancel})
    (download,) = page.outbox.stream._downloads
    assert len(zipfile.ZipFile(io.BytesIO(download.data)).namelist()) == 2
