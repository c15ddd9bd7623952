"""Tests of the queue of messages for a page."""

from __future__ import annotations

import asyncio
import json

from tests.preview.web.pictures import picture
from usdsplat.preview.web.outbox import Outbox


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


def test_one_frame_is_under_way_and_the_latest_one_waits() -> None:
    """Oracle: a sliding window of one."""

    async def main() -> None:
        outbox = Outbox()
        for number in (1, 2, 3):
            outbox.show(picture(number=number))
        assert (await outbox.taken())[1].number == 3
        for number in (4, 5):
            outbox.show(picture(number=number))
        outbox.acknowledged(2)
        outbox.acknowledged(5)
        outbox.tell("busy", "")
        assert (await outbox.taken())[1] is None
        waiting = asyncio.create_task(outbox.taken())
        await asyncio.sleep(0)
        assert not waiting.done()
        outbox.acknowledged(3)
        assert (await waiting)[1].number == 5

    asyncio.run(main())
