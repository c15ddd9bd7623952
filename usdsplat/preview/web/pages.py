"""Track the open pages, and which of them drives.

A session shows one view. One page drives it; the others watch: they get the same pictures and
news, each as fast as its own link permits. A watching page may take control. When the driving page
goes, the one that has watched the longest drives. A page that lost its connection reconnects under
its own name, and drives again if no other page does.
"""

from __future__ import annotations

from itertools import count

from usdsplat.core.errors import UsageError
from usdsplat.preview.web.outbox import Outbox
from usdsplat.preview.web.stream import Download

MOST_WAITING = 2**29
"""Most bytes of files that wait for all pages together; a single file may have more. A recording,
which takes long, begins only if there is room, and is sent in any case."""


class Page:
    """One connection of a browser."""

    def __init__(self) -> None:
        self.outbox = Outbox()
        self.name: str | None = None
        """Name chosen by the page; None until it has said hello."""
        self.number = 0
        """Number by which people tell the pages apart, from 1."""
        self.size = (16, 16)
        """Width and height of its viewport [pixel]."""


class Pages:
    """All pages of a server."""

    def __init__(self) -> None:
        self._open: list[Page] = []
        self.driver: Page | None = None
        """The page that drives."""

    def __len__(self) -> int:
        return len(self._open)

    @property
    def present(self) -> tuple[Page, ...]:
        """The pages that have said hello, in that order."""
        return tuple(page for page in self._open if page.name is not None)

    @property
    def waiting(self) -> int:
        """Bytes of the files that wait for their pages."""
        return sum(page.outbox.stream.waiting for page in self._open)

    def send(self, page: Page, download: Download) -> None:
        """Send a page a file, or a sentence if too much waits already for it and the others."""
        before = self.waiting
        if before and before + len(download.data) > MOST_WAITING:
            found = f"files of {before} bytes under way to all viewers"
            expected = "fewer: save it again when they have arrived"
            page.outbox.tell("problem", str(UsageError(download.name, found, expected)))
        else:
            page.outbox.send(download)

    def enter(self, page: Page) -> None:
        """Add a page, which may not do anything yet."""
        self._open.append(page)

    def greet(self, page: Page, name: str) -> None:
        """Let a page drive that said its name, if no other does; else it watches."""
        taken = {each.number for each in self.present}
        page.number = page.number or next(each for each in count(1) if each not in taken)
        page.name = name
        self._open.remove(page)
        self._open.append(page)  # the order is that of greetings
        if self.driver is None or self.driver.name == name:
            self.driver = page
        self.tell_seats()

    def take_over(self, page: Page) -> None:
        """Let a page drive, whoever did."""
        self.driver = page
        self.tell_seats()

    def leave(self, page: Page) -> None:
        """Remove a page; if it drove, the one that has watched the longest drives."""
        self._open.remove(page)
        if self.driver is page:
            self.driver = next(iter(self.present), None)
        self.tell_seats()

    def tell_seats(self) -> None:
        """Tell every page who drives and who watches."""
        for page in self.present:
            page.outbox.keep(
                "seats",
                {
                    "you": page.number,
                    "driver": None if self.driver is None else self.driver.number,
                    "pages": len(self.present),
                },
            )
