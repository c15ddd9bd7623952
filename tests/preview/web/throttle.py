"""A TCP proxy with the bandwidth and the round trip of a slow link."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from concurrent.futures import Future

PIECE = 1448
"""Bytes of a packet."""
BUFFER = 0.25
"""Delay of a full buffer in front of the bottleneck; then it takes no more [s]."""


class _Line:
    """One direction of the link, which all connections share."""

    def __init__(self, bandwidth: float) -> None:
        self._bandwidth = bandwidth
        self._free = 0.0

    async def take(self, size: int) -> float:
        """Wait for room in the buffer; return when the bytes are through."""
        clock = asyncio.get_running_loop().time
        while self._free - clock() > BUFFER:
            await asyncio.sleep(self._free - clock() - BUFFER)
        self._free = max(self._free, clock()) + size / self._bandwidth
        return self._free


class Throttle:
    """A proxy on a port of its own, for tests and benchmarks.

    Args:
        port: Of the server, on this machine.
        bandwidth: Of each direction [byte/s].
        round_trip: Without queues [s]; opening a connection takes one, too.
    """

    def __init__(self, port: int, *, bandwidth: float, round_trip: float) -> None:
        self._server, self._trip = port, round_trip
        self._up, self._down = _Line(bandwidth), _Line(bandwidth)
        self.delivered = 0
        """Bytes towards the client so far."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listening: Future[int] = Future()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._thread.start()
        self.port = self._listening.result()

    def close(self) -> None:
        """End every connection."""
        assert self._loop is not None
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = await asyncio.start_server(self._connect, "127.0.0.1", 0)
        self._listening.set_result(server.sockets[0].getsockname()[1])
        await self._stop.wait()
        server.close()

    async def _connect(self, near: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await asyncio.sleep(self._trip)
        far, there = await asyncio.open_connection("127.0.0.1", self._server, limit=4 * PIECE)
        with contextlib.suppress(asyncio.CancelledError):  # the end of the proxy
            await asyncio.gather(
                self._pass(near, there, self._up),
                self._pass(far, writer, self._down),
                return_exceptions=True,
            )

    async def _pass(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, line: _Line
    ) -> None:
        pieces: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        sending = asyncio.create_task(self._send(pieces, writer, line))
        try:
            while data := await reader.read(PIECE):
                through = await line.take(len(data))
                pieces.put_nowait((through + 0.5 * self._trip, data))
        finally:
            pieces.put_nowait((0.0, b""))
            await sending

    async def _send(
        self,
        pieces: asyncio.Queue[tuple[float, bytes]],
        writer: asyncio.StreamWriter,
        line: _Line,
    ) -> None:
        clock = asyncio.get_running_loop().time
        with contextlib.suppress(ConnectionError):
            while data := (item := await pieces.get())[1]:
                await asyncio.sleep(max(0.0, item[0] - clock()))
                writer.write(data)
                await writer.drain()
                self.delivered += len(data) if line is self._down else 0
        writer.close()
