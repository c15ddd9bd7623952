"""Measure the connection to one page from its acknowledgements.

The bandwidth is the largest of the last delivery rates: bytes that arrived while a message was
under way, divided by that time, as in BBR (Cardwell et al., "BBR: Congestion-Based Congestion
Control", ACM Queue 14(5), 2016). A rate that was measured while too little was sent can only raise
the estimate. The round trip is the shortest of the last messages that were sent into an empty link.

Times are those of any monotonic clock [s]; nothing here reads one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

LEAST_WINDOW = 24_000
"""Smallest window [byte]: the delay-bandwidth product of 1 Mbit/s at a round trip of 200 ms."""
QUEUE = 0.1
"""Delay that may queue on the link, so that it is never idle and a faster one is noticed [s]."""
MOST_UNDER_WAY = 8
"""Most messages under way; a page that acknowledges nothing gets no more."""
RATES, TRIPS = 10, 4
"""Number of delivery rates and round trips that are remembered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sent:
    """A message under way."""

    size: int
    at: float
    delivered: int
    """Bytes that had arrived when it was sent."""
    delivered_at: float
    """Time of the last arrival before it was sent."""
    is_alone: bool
    """Whether nothing else was under way."""
    was_held: bool
    """Whether the window was full: the link, not the sender, limits the rate."""


class Link:
    """The connection to one page; messages are numbered in the order in which they are sent."""

    def __init__(self) -> None:
        self._next = 0
        self._sent: dict[int, _Sent] = {}
        self._delivered, self._delivered_at = 0, 0.0
        self._under_way = 0
        self._is_held = False
        self._rates: deque[float] = deque(maxlen=RATES)
        self._trips: deque[float] = deque(maxlen=TRIPS)

    @property
    def bandwidth(self) -> float | None:
        """Bandwidth [byte/s]; None until the first acknowledgement."""
        return max(self._rates, default=None)

    @property
    def round_trip(self) -> float | None:
        """Round trip, including the page's work on a message [s]; None until it is measured."""
        return min(self._trips, default=None)

    @property
    def window(self) -> float:
        """Most bytes under way."""
        bandwidth, trip = self.bandwidth, self.round_trip
        if bandwidth is None or trip is None:
            return LEAST_WINDOW
        return max(LEAST_WINDOW, bandwidth * (trip + QUEUE))

    @property
    def under_way(self) -> int:
        """Bytes that were sent and not acknowledged."""
        return self._under_way

    def has_room(self) -> bool:
        """Return whether another message may be sent; False notes that the link is full."""
        has_room = self._under_way < self.window and len(self._sent) < MOST_UNDER_WAY
        self._is_held = self._is_held or not has_room
        return has_room

    def sent(self, size: int, now: float) -> int:
        """Record a message of `size` bytes and return its number."""
        is_alone = not self._sent
        if is_alone:
            self._delivered_at = now  # the time without messages counts for nothing
        self._next += 1
        self._sent[self._next] = _Sent(
            size=size,
            at=now,
            delivered=self._delivered,
            delivered_at=self._delivered_at,
            is_alone=is_alone,
            was_held=self._is_held,
        )
        self._under_way += size
        self._is_held = False
        return self._next

    def acknowledged(self, number: int, now: float) -> None:
        """Record that a message arrived; unknown numbers are ignored."""
        sent = self._sent.pop(number, None)
        if sent is None:
            return
        self._under_way -= sent.size
        self._delivered += sent.size
        self._delivered_at = now
        rate = (self._delivered - sent.delivered) / max(now - sent.delivered_at, 1e-4)
        if sent.was_held or rate >= (self.bandwidth or 0.0):
            self._rates.append(rate)
        if sent.is_alone:
            self._trips.append(max(now - sent.at, 1e-4))
