"""Tests of the page in a headless browser behind a slow link."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest

from tests.delegate.stages import two_fields
from tests.preview.web.seats import Seat, animated
from tests.preview.web.throttle import Throttle
from usdsplat.preview.document import Document
from usdsplat.preview.web.stream import FIRST

BANDWIDTH, TRIP = 125e3, 0.2
"""1 Mbit/s and 200 ms."""


@pytest.fixture(scope="module")
def seat(browser: Any) -> Iterator[Seat]:
    stage = animated(two_fields(), "/World/B")
    seat = Seat(browser, lambda publish: Document(stage, publish=publish))
    yield seat
    seat.close()


def test_what_crosses_a_slow_link(seat: Seat) -> None:
    """Oracle: the frames of the socket: the first picture is small and comes at once; in the end
    the page has the session's array. What a drag sends is tested with a clock of its own, see
    `test_stream`."""
    seat.rested()
    throttle = Throttle(urlsplit(seat.server.url).port or 0, bandwidth=BANDWIDTH, round_trip=TRIP)
    images: list[dict[str, Any]] = []

    def received(payload: Any) -> None:
        if isinstance(payload, bytes):
            (length,) = struct.unpack(">I", payload[:4])
            header = json.loads(payload[4 : 4 + length])
            images.append({**header, "size": len(payload) - 4 - length})

    def watch(page: Any) -> None:
        page.on("websocket", lambda socket: socket.on("framereceived", received))

    try:
        page = seat.sit(port=throttle.port, prepare=watch)
        page.wait_for_function("() => document.getElementById('picture').dataset.final === 'true'")
        assert images[0]["size"] <= FIRST
        assert images[0]["parts"] == 1 and not images[0]["is_final"]
        number = seat.rested()
        page.wait_for_function(
            f"() => document.getElementById('picture').dataset.number === '{number}'"
            " && document.getElementById('picture').dataset.final === 'true'"
        )
        first, seat.page = seat.page, page
        shown = seat.canvas()[1]
        seat.page = first
        assert (shown == seat.picture(number).image).all()
        page.close()
    finally:
        throttle.close()
    assert seat.errors == []
