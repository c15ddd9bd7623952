"""A link of a given bandwidth and round trip, with a clock of its own."""

from __future__ import annotations

import heapq
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from usdsplat.preview.values import Picture
from usdsplat.preview.web.stream import PictureStream


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """A message at the page."""

    at: float
    header: dict[str, Any]
    size: int
    """Of the message [byte]."""


class SimulatedLink:
    """A stream of pictures to a page behind a bottleneck, which is first in, first out.

    Args:
        bandwidth: Of the bottleneck [byte/s].
        round_trip: Without any queue [s].
        decoding: Time for which the page decodes a picture [s].
    """

    def __init__(self, bandwidth: float, round_trip: float, *, decoding: float = 0.01) -> None:
        self.stream = PictureStream()
        self.bandwidth, self.round_trip, self.decoding = bandwidth, round_trip, decoding
        self.now = 0.0
        self.arrivals: list[Arrival] = []
        self.files: list[tuple[dict[str, Any], bytes]] = []
        """Parts of files: header and bytes."""
        self.most_under_way = 0
        """Most bytes under way at a time."""
        self._is_free_at = 0.0
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0

    def at(self, time: float, action: Callable[[], None]) -> None:
        """Do something at a time."""
        self._count += 1
        heapq.heappush(self._due, (time, self._count, action))

    def show(self, time: float, picture: Picture) -> None:
        """Have a picture drawn at a time."""
        self.at(time, lambda: self.stream.show(picture))

    def run(self, until: float) -> None:
        """Let time pass."""
        while self._due and self._due[0][0] <= until:
            self.now, _, action = heapq.heappop(self._due)
            action()
            self._send()
        self.now = until

    def shown(self) -> list[Arrival]:
        """The last parts of pictures: when each could be shown."""
        return [each for each in self.arrivals if each.header["part"] == each.header["parts"] - 1]

    def _send(self) -> None:
        while True:
            data = self.stream.next(self.now)
            if data is None:
                order = self.stream.order()
                if order is not None:
                    self.stream.take(order, order.encoded())
                    continue
                data = self.stream.next_of_download(self.now)
                if data is None:
                    return
            self.most_under_way = max(self.most_under_way, self.stream.link.under_way)
            self._is_free_at = max(self._is_free_at, self.now) + len(data) / self.bandwidth
            self.at(self._is_free_at + 0.5 * self.round_trip, lambda data=data: self._arrive(data))

    def _arrive(self, data: bytes) -> None:
        (length,) = struct.unpack(">I", data[:4])
        header = json.loads(data[4 : 4 + length])
        is_last = header.get("part", 0) == header.get("parts", 0) - 1
        if "file" in header:
            self.files.append((header, data[4 + length :]))
        else:
            self.arrivals.append(Arrival(at=self.now, header=header, size=len(data)))
        back = self.now + 0.5 * self.round_trip + (self.decoding if is_last else 0.0)
        self.at(back, lambda: self.stream.acknowledged(header["message"], self.now))
