"""Track the open pages, and which of them has the view.

A session shows one view, so one page holds it. Another page is told that the view is in use and may
take it over; then the previous holder is told the same and may take it back. A page that lost its
connection reconnects under its own name and is let in at once.
"""

from __future__ import annotations

from usdsplat.preview.web.outbox import Outbox


class Page:
    """One connection of a browser."""

    def __init__(self) -> None:
        self.outbox = Outbox()
        self.name: str | None = None
        """Name given by the page; None until it has said hello."""


class Pages:
    """All pages of a server."""

    def __init__(self) -> None:
        self._open: list[Page] = []
        self.holder: Page | None = None
        """The page that has the view."""

    def __len__(self) -> int:
        return len(self._open)

    def enter(self, page: Page) -> None:
        """Add a page, which may not do anything yet."""
        self._open.append(page)

    def greet(self, page: Page, name: str) -> bool:
        """Give the view to a page that said its name, if the view is free or was its own."""
        page.name = name
        if self.holder is None or self.holder.name == name:
            self.take_over(page)
        else:
            page.outbox.tell("in_use", None)
        return self.holder is page

    def take_over(self, page: Page) -> None:
        """Give the view to a page, whoever had it."""
        loser, self.holder = self.holder, page
        if loser is not None and loser is not page:
            loser.outbox.tell("in_use", None)

    def leave(self, page: Page) -> bool:
        """Remove a page and return whether it had the view, which is now free."""
        self._open.remove(page)
        if self.holder is not page:
            return False
        self.holder = None
        for each in self._open:
            if each.name is not None:
                each.outbox.tell("free", None)
        return True
