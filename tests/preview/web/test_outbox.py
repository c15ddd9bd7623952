"""Tests of the queue of messages for a page."""

from __future__ import annotations

import asyncio
import json
import struct

from tests.preview.web.pictures import picture
from usdsplat.preview.web.outbox import MOST_NEWS, Outbox
from usdsplat.preview.web.stream import MOST_DOWNLOADS, Download, Order


def test_the_latest_of_each_kind_waits() -> None:
    """Oracle: a page that never listens holds one message of a kind, in the order of first news."""

    async def main() -> None:
        outbox = Outbox()
        for number in range(1000):
            outbox.tell("state", number)
            outbox.tell("busy", str(number))
        news, shown = await outbox.taken()
        assert [json.loads(each) for each in news] == [
            {"type": "state", "content": 999},
            {"type": "busy", "content": "999"},
        ]
        assert shown is None

    asyncio.run(main())


def test_a_state_that_the_page_has_is_not_sent_again() -> None:
    """Oracle: the same content, then another, and the first again."""

    async def main() -> None:
        outbox = Outbox()
        found = []
        for content in (1, 1, 2, 2, 1):
            outbox.keep("state", content)
            outbox.tell("mark", content)
            news, _ = await outbox.taken()
            found.append([json.loads(each)["content"] for each in news])
        assert found == [[1, 1], [1], [2, 2], [2], [1, 1]]

    asyncio.run(main())


def test_pictures_are_encoded_and_sent_while_the_link_has_room() -> None:
    """Oracle: the protocol: an order, its message, and a wait for the next picture."""

    async def main() -> None:
        outbox = Outbox()
        for number in (1, 2, 3):
            outbox.show(picture(number=number, is_final=False))
        _, order = await outbox.taken()
        assert isinstance(order, Order) and order.picture.number == 3
        outbox.stream.take(order, order.encoded())
        _, data = await outbox.taken()
        assert isinstance(data, bytes)
        (length,) = struct.unpack(">I", data[:4])
        assert json.loads(data[4 : 4 + length])["number"] == 3
        waiting = asyncio.create_task(outbox.taken())
        await asyncio.sleep(0)
        assert not waiting.done()
        outbox.show(picture(number=4))
        assert isinstance((await waiting)[1], Order)

    asyncio.run(main())


def test_answers_of_several_subjects_wait_up_to_a_limit() -> None:
    """Oracle: the newest of each subject, and of too many the last ones."""

    async def main() -> None:
        outbox = Outbox()
        for number in range(MOST_NEWS + 50):
            for content in ("old", "new"):
                outbox.tell("prims", [number, content], subject=f"/{number}")
        news, _ = await outbox.taken()
        found = [json.loads(each)["content"] for each in news]
        assert found == [[number, "new"] for number in range(50, MOST_NEWS + 50)]

    asyncio.run(main())


def test_a_state_that_waits_is_not_lost_among_many_answers() -> None:
    """Oracle: the page would never get it again, since it counts as known."""

    async def main() -> None:
        outbox = Outbox()
        outbox.keep("state", 1)
        for number in range(2 * MOST_NEWS):
            outbox.tell("prims", number, subject=f"/{number}")
        news, _ = await outbox.taken()
        assert json.loads(news[0]) == {"type": "state", "content": 1}
        assert len(news) == MOST_NEWS

    asyncio.run(main())


def test_a_file_too_many_is_told() -> None:
    """Oracle: a sentence with the file's name; nothing is dropped silently."""

    async def main() -> None:
        outbox = Outbox()
        for number in range(MOST_DOWNLOADS + 1):
            outbox.send(Download(name=f"{number}.png", encoding="image/png", data=b"x"))
        news, _ = await outbox.taken()
        (message,) = (json.loads(each) for each in news)
        assert message["type"] == "problem"
        assert message["content"].startswith(f"{MOST_DOWNLOADS}.png: found")

    asyncio.run(main())
