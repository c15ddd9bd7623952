"""Choose what a page gets of the pictures: how well encoded, in which parts, and when.

    stream.show(picture)                     # the newest replaces one that is not sent yet
    order = stream.order()                   # what to encode next; None if nothing is to be sent
    stream.take(order, order.encoded())      # encoding takes milliseconds: in another thread
    data = stream.next(now)                  # the next message; None while the link is full
    stream.acknowledged(message, now)        # the page has it

While the view moves, pictures fit the link: `RATE` of them arrive each second. Several are under
way, because a round trip may take longer than one of them. A view at rest arrives quickly first,
then sharp, then exact; on a fast link it is exact at once. Parts of sharp and exact pictures that
are not sent yet are dropped when a newer picture comes, so a move never waits for them. Quick ones
are always sent completely, so there is progress however fast new pictures come.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from usdsplat.core.errors import UsageError
from usdsplat.preview.values import Picture
from usdsplat.preview.web import frames
from usdsplat.preview.web.frames import Encoded, Stage
from usdsplat.preview.web.link import Link

RATE = 10.0
"""Quick pictures per second that fit the link."""
FIRST = 8_000
"""Bytes of a quick picture while the bandwidth is not known."""
LEAST = 1_500
"""Smallest budget of a quick picture [byte]."""
SOON = 0.25
"""Time within which an exact picture must arrive to be sent without a worse one before [s]."""
PART = 0.1
"""Time that a part of a picture takes [s]."""
LEAST_PART = 8_000
"""Smallest part [byte]."""
MOST_DOWNLOADS = 4
"""Most files that wait."""
_EXACT_SIZE = 1.2  # bytes per pixel of an exact picture before the first one


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Download:
    """A file that the page saves."""

    name: str
    encoding: str
    """Its media type."""
    data: bytes


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Order:
    """A picture to encode."""

    picture: Picture
    stage: Stage
    budget: float
    """Most bytes of a quick picture."""
    detail: float
    """As for `frames.quick`."""

    def encoded(self) -> Encoded:
        """Encode it."""
        if self.stage == "quick":
            return frames.quick(self.picture, self.budget, detail=self.detail)
        return frames.exact(self.picture) if self.stage == "exact" else frames.sharp(self.picture)


class PictureStream:
    """The pictures of one page."""

    def __init__(self) -> None:
        self.link = Link()
        self._picture: Picture | None = None
        self._sent: list[Stage] = []
        """Stages of the newest picture that were sent."""
        self._current: tuple[Encoded, Stage] | None = None
        self._part, self._parts = 0, 0
        self._downloads: deque[Download] = deque()
        self._sent_of_download = 0
        self._detail = 1.0
        self._exact_size = _EXACT_SIZE

    def show(self, picture: Picture) -> None:
        """Show a picture from now on."""
        self._picture, self._sent = picture, []
        if self._current is not None and self._current[1] != "quick":
            self._current = None

    def order(self) -> Order | None:
        """Return what to encode now: the newest picture, once the link has room for it."""
        stage = self._stage()
        if self._picture is None or stage is None or self._current is not None:
            return None
        if not self.link.has_room():
            return None
        bandwidth = self.link.bandwidth
        budget = FIRST if bandwidth is None else max(LEAST, bandwidth / RATE)
        return Order(picture=self._picture, stage=stage, budget=budget, detail=self._detail)

    def take(self, order: Order, encoded: Encoded) -> None:
        """Send an encoded picture, unless a newer one has made it superfluous."""
        is_newest = order.picture is self._picture
        if order.stage == "quick":
            self._detail = encoded.detail
        elif not is_newest:
            return
        if order.stage == "exact":
            self._exact_size = len(encoded.image) / _pixels(order.picture)
        if is_newest:
            self._sent.append(order.stage)
        size = max(LEAST_PART, PART * (self.link.bandwidth or 0.0))
        self._current = encoded, order.stage
        self._part, self._parts = 0, max(1, round(len(encoded.image) / size))

    def next(self, now: float) -> bytes | None:
        """Return the next message; None if the link is full, or nothing is encoded."""
        if self._current is None or not self.link.has_room():
            return None
        first = len(self._current[0].image) * self._part // self._parts
        last = len(self._current[0].image) * (self._part + 1) // self._parts
        number = self.link.sent(last - first, now)
        data = frames.message(self._current[0], self._part, self._parts, message=number)
        self._part += 1
        if self._part == self._parts:
            self._current = None
        return data

    def send(self, download: Download) -> None:
        """Send a file.

        Raises:
            UsageError: If too many files wait.
        """
        if (count := len(self._downloads)) == MOST_DOWNLOADS:
            found = f"{count} files before it"
            raise UsageError(download.name, found, "fewer: save it again when they have arrived")
        self._downloads.append(download)

    @property
    def waiting(self) -> int:
        """Bytes of the files that are not sent completely."""
        return sum(len(each.data) for each in self._downloads)

    def next_of_download(self, now: float) -> bytes | None:
        """Return a part of a file, which pictures precede; None as for `next`."""
        if not self._downloads or self._current is not None or not self.link.has_room():
            return None
        file = self._downloads[0]
        first = self._sent_of_download
        last = first + int(max(LEAST_PART, PART * (self.link.bandwidth or 0.0)))
        head = {
            "file": file.name,
            "encoding": file.encoding,
            "is_first": first == 0,
            "is_last": last >= len(file.data),
            "size": len(file.data),
            "message": self.link.sent(min(last, len(file.data)) - first, now),
        }
        if last >= len(file.data):
            self._downloads.popleft()
        self._sent_of_download = 0 if last >= len(file.data) else last
        return frames.packed(head, file.data[first:last])

    def acknowledged(self, number: int, now: float) -> None:
        """Record that a message arrived."""
        self.link.acknowledged(number, now)

    # --- private ---------------------------------------------------------------------------

    def _stage(self) -> Stage | None:
        """Return how to encode the newest picture next; None if all of it was sent."""
        if self._picture is None or "exact" in self._sent:
            return None
        if not self._picture.is_final:
            return None if self._sent else "quick"
        bandwidth = self.link.bandwidth
        if bandwidth and self._exact_size * _pixels(self._picture) <= SOON * bandwidth:
            return "exact"
        if not self._sent:
            return "quick"
        return "exact" if "sharp" in self._sent else "sharp"


def _pixels(picture: Picture) -> int:
    height, width = picture.image.shape[:2]
    return height * width
