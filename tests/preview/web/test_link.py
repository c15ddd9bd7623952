"""Tests of measuring a link, by a clock of their own."""

from __future__ import annotations

import pytest

from usdsplat.preview.web.link import LEAST_WINDOW, MOST_UNDER_WAY, QUEUE, Link


def saturated(
    link: Link, *, bandwidth: float, round_trip: float, start: float, until: float
) -> None:
    """Send messages of 8 kB whenever there is room, through a first-in first-out bottleneck."""
    now, free = start, start
    arrivals: list[tuple[float, int]] = []
    while now < until:
        while link.has_room():
            free = max(free, now) + 8000 / bandwidth
            arrivals.append((free + round_trip, link.sent(8000, now)))
        now, number = arrivals.pop(0)
        link.acknowledged(number, now)
    for at, number in arrivals:
        link.acknowledged(number, at)


@pytest.mark.parametrize(
    ("bandwidth", "round_trip"), [(125e3, 0.2), (125e3, 0.02), (30e3, 0.5), (1e6, 0.1)]
)
def test_bandwidth_and_round_trip_are_those_of_the_link(
    bandwidth: float, round_trip: float
) -> None:
    """Oracle: the simulated bottleneck; the first message's own time is part of its trip."""
    link = Link()
    saturated(link, bandwidth=bandwidth, round_trip=round_trip, start=0.0, until=6.0)
    most = MOST_UNDER_WAY * 8000 / (round_trip + 8000 / bandwidth)
    assert link.bandwidth == pytest.approx(min(bandwidth, most), rel=0.1)
    assert link.round_trip == pytest.approx(round_trip + 8000 / bandwidth, rel=0.01)


def test_a_slower_link_is_noticed_while_it_is_full() -> None:
    """Oracle: the bandwidth halves; ten rates later the old one is forgotten."""
    link = Link()
    saturated(link, bandwidth=200e3, round_trip=0.1, start=0.0, until=3.0)
    saturated(link, bandwidth=100e3, round_trip=0.1, start=10.0, until=14.0)
    assert link.bandwidth == pytest.approx(100e3, rel=0.1)


def test_a_view_that_sends_little_does_not_make_the_link_slow() -> None:
    """Oracle: 1 kB each second says nothing of a link that carried 200 kB each second."""
    link = Link()
    saturated(link, bandwidth=200e3, round_trip=0.1, start=0.0, until=3.0)
    before = link.bandwidth
    for second in range(20, 60):
        assert link.has_room()
        link.acknowledged(link.sent(1000, second), second + 0.1)
    assert link.bandwidth == before


def test_the_window_is_the_product_of_delay_and_bandwidth() -> None:
    """Oracle: bandwidth × (round trip + QUEUE), and a floor before anything is known."""
    link = Link()
    assert link.window == LEAST_WINDOW and link.bandwidth is None and link.round_trip is None
    link.acknowledged(link.sent(100_000, 1.0), 1.5)
    assert link.bandwidth == pytest.approx(200e3) and link.round_trip == pytest.approx(0.5)
    assert link.window == pytest.approx(200e3 * (0.5 + QUEUE))


def test_a_page_that_acknowledges_nothing_fills_its_window() -> None:
    """Oracle: the limits in bytes and in messages; unknown numbers change nothing."""
    for size in (8000, 100):
        link = Link()
        count = 0
        while link.has_room():
            link.sent(size, 0.0)
            count += 1
        assert count == min(MOST_UNDER_WAY, LEAST_WINDOW // size)
        link.acknowledged(999, 1.0)
        assert not link.has_room()
