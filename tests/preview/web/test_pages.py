"""Tests of the pages of a server: what waits for all of them together."""

from __future__ import annotations

import asyncio
import json

import pytest

from usdsplat.preview.web import pages as pages_module
from usdsplat.preview.web.pages import Page, Pages
from usdsplat.preview.web.stream import Download


def file_of(name: str, size: int) -> Download:
    return Download(name=name, encoding="image/png", data=bytes(size))


def test_the_bytes_of_waiting_files_are_bounded_over_all_pages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Oracle: a limit of ten bytes: what exceeds it waits for no page, and the page that asked is
    told; a file that is larger may be sent alone."""
    monkeypatch.setattr(pages_module, "MOST_WAITING", 10)

    async def main() -> None:
        pages, one, other = Pages(), Page(), Page()
        pages.enter(one)
        pages.enter(other)
        pages.send(one, file_of("a", 6))
        pages.send(other, file_of("b", 4))
        pages.send(other, file_of("c", 1))
        assert pages.waiting == 10
        told = [json.loads(each) for each in (await other.outbox.taken())[0]]
        assert [each["type"] for each in told] == ["problem"]
        assert told[0]["content"].startswith("c: found files of 10 bytes")
        assert pages.waiting == 6  # b has been taken
        pages.leave(one)
        pages.send(other, file_of("d", 10))
        assert pages.waiting == 10
        pages.leave(other)
        alone = Page()
        pages.enter(alone)
        pages.send(alone, file_of("e", 30))
        assert pages.waiting == 30

    asyncio.run(main())
