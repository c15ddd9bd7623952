"""Tests of what a page gets over a link, with a simulated link and clock."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from itertools import pairwise

import pytest

from tests.preview.web.pictures import scenery
from tests.preview.web.simulated_link import SimulatedLink
from usdsplat.core.errors import UsageError
from usdsplat.preview.web.stream import (
    FIRST,
    MOST_DOWNLOADS,
    RATE,
    Download,
    PictureStream,
)

SLOW = {"bandwidth": 125e3, "round_trip": 0.2}
"""1 Mbit/s, and 200 ms."""
MOVING = scenery(is_final=False, width=960)
RESTING = scenery(width=960)


def dragged(link: SimulatedLink, start: float, end: float, *, rate: float = 28.0) -> None:
    """Have pictures drawn as fast as the renderer's pacing does."""
    for count in range(int((end - start) * rate)):
        link.show(start + count / rate, MOVING)


def test_the_first_picture_comes_in_one_trip() -> None:
    """Oracle: half a round trip, and its bytes by the bandwidth: 0.2 s of 1.5."""
    link = SimulatedLink(**SLOW)
    link.show(0.0, RESTING)
    link.run(3.0)
    first = link.shown()[0]
    assert first.size < FIRST + 1000
    assert first.at == pytest.approx(0.1 + first.size / 125e3)


@pytest.mark.parametrize(("bandwidth", "round_trip"), [(125e3, 0.2), (60e3, 0.2), (125e3, 0.4)])
def test_eight_pictures_a_second_arrive_during_a_drag(bandwidth: float, round_trip: float) -> None:
    """Oracle: arrivals by the simulated clock; stop-and-wait would give 1 / (trip + bytes)."""
    link = SimulatedLink(bandwidth, round_trip)
    dragged(link, 0.0, 6.0)
    link.run(6.0)
    shown = [each for each in link.shown() if each.at > 2.0]
    assert len(shown) / 4.0 >= 8
    apart = [later.at - earlier.at for earlier, later in pairwise(shown)]
    assert max(apart) < 0.25
    assert max(each.size for each in shown) < bandwidth / RATE + 1000


def test_a_picture_is_not_older_than_a_trip_and_a_short_queue() -> None:
    """Oracle: the window: what is under way crosses the bottleneck in a trip and 0.1 s, plus the
    message that was let in last."""
    link = SimulatedLink(**SLOW)
    dragged(link, 0.0, 6.0)
    link.run(6.0)
    assert link.most_under_way <= 125e3 * (0.3 + 0.1 + 2 / RATE)


def test_a_view_at_rest_becomes_sharp_and_then_exact() -> None:
    """Oracle: the stages, and their times by the bandwidth."""
    link = SimulatedLink(**SLOW)
    dragged(link, 0.0, 3.0)
    link.show(3.0, RESTING)
    link.run(60.0)
    rest = [each for each in link.arrivals if each.at > 3.0 and each.header["part"] == 0]
    sharp, exact = rest[-2:]
    assert sharp.header["is_sharp"] and not sharp.header["is_final"]
    assert exact.header["is_final"] and exact.header["width"] == 960
    assert exact.at < 4.6
    assert [each.header["part"] for each in link.arrivals if each.at >= exact.at] == list(
        range(exact.header["parts"])
    )


def test_a_move_does_not_wait_for_an_exact_picture() -> None:
    """Oracle: the exact one would take seconds; the move's first picture comes after what is
    under way, in less than half a second more than a trip."""
    link = SimulatedLink(**SLOW)
    dragged(link, 0.0, 2.0)
    link.show(2.0, RESTING)
    link.run(4.6)
    assert not any(each.header.get("is_final") for each in link.shown())
    dragged(link, 4.6, 5.6)
    link.run(6.5)
    moved = next(each for each in link.arrivals if each.at > 4.6 and each.header["part"] == 0)
    assert not moved.header["is_sharp"] and moved.at < 4.6 + 0.1 + 0.5


def test_a_fast_link_gets_every_picture_and_exact_ones_at_once() -> None:
    """Oracle: 100 MB/s and 1 ms: as many arrive as are drawn, and JPEGs of full size."""
    link = SimulatedLink(100e6, 0.001)
    dragged(link, 0.0, 2.0)
    link.show(2.0, RESTING)
    link.run(3.0)
    shown = link.shown()
    assert len(shown) == 56 + 1
    assert [each.header["encoding"] for each in shown[5:-1]] == ["image/jpeg"] * 51
    assert shown[-1].header["is_final"] and shown[-1].header["parts"] == 1


def test_pictures_that_come_faster_than_they_can_be_sent_are_left_out() -> None:
    """Oracle: the numbers that arrive increase, and the last one is the newest."""
    link = SimulatedLink(**SLOW)
    for number in range(200):
        link.show(number / 100, replace(MOVING, number=number, is_final=number == 199))
    link.run(20.0)
    numbers = [each.header["number"] for each in link.shown()]
    assert numbers == sorted(numbers) and numbers[-1] == 199 and len(set(numbers)) < 60


def test_a_file_arrives_whole_and_pictures_precede_it() -> None:
    """Oracle: its bytes in order; of a drag as many pictures arrive as without it."""
    data = bytes(range(256)) * 2000
    link = SimulatedLink(**SLOW)
    dragged(link, 0.0, 4.0)
    link.at(1.0, lambda: link.stream.send(Download(name="a.png", encoding="image/png", data=data)))
    link.run(4.0)
    assert len([each for each in link.shown() if each.at > 2.0]) / 2.0 >= 8
    link.run(30.0)
    assert b"".join(body for _, body in link.files) == data
    heads = [head for head, _ in link.files]
    assert [head["is_first"] for head in heads] == [True] + [False] * (len(heads) - 1)
    assert [head["is_last"] for head in heads] == [False] * (len(heads) - 1) + [True]
    assert {head["size"] for head in heads} == {len(data)}


def test_few_files_wait() -> None:
    """Oracle: the limit; what is accepted arrives, in order."""
    made = [
        Download(name=f"{number}", encoding="image/png", data=bytes(2))
        for number in range(MOST_DOWNLOADS + 1)
    ]
    pictures = PictureStream()
    for each in made[:-1]:
        pictures.send(each)
    assert pictures.waiting == 2 * MOST_DOWNLOADS
    with pytest.raises(UsageError, match=f"{MOST_DOWNLOADS}: found {MOST_DOWNLOADS} files"):
        pictures.send(made[-1])
    assert sent(pictures) == [each.name for each in made[:-1]] and pictures.waiting == 0


def sent(pictures: PictureStream) -> list[str]:
    """Names of the files that are sent now."""
    found = []
    while (data := pictures.next_of_download(0.0)) is not None:
        (length,) = struct.unpack(">I", data[:4])
        head = json.loads(data[4 : 4 + length])
        pictures.acknowledged(head["message"], 0.0)
        found.append(head["file"])
    return found
