"""Peers in processes that keep running, so that they are warm when they are timed."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any


class Server:
    """A process that answers JSON objects with JSON objects, one per line.

    Other lines, which libraries print, are ignored.

    Args:
        name: Name for messages.
        command: Command line of the process.
    """

    def __init__(self, name: str, command: Sequence[str]) -> None:
        self._name = name
        self._process = subprocess.Popen(
            list(command),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send a request and return the answer.

        Raises:
            RuntimeError: If it fails, with its message.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # the process has ended, which the missing answer shows
        answer = self._answer()
        if "error" in answer:
            raise RuntimeError(f"{self._name}: {answer['error']}")
        return answer

    def cpu_seconds(self) -> float:
        """Return the processor time of the process and its descendants, as reported by Linux with a
        resolution of 10 ms."""
        ticks, children = {}, {}
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has just ended
            number = int(folder.name)
            ticks[number] = int(fields[11]) + int(fields[12])
            children.setdefault(int(fields[1]), []).append(number)
        total, left = 0, [self._process.pid]
        while left:
            number = left.pop()
            total += ticks.get(number, 0)
            left += children.get(number, [])
        return total / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it has ended without reading the last request
            self._process.stdin.close()
        self._process.wait()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith("{"):
                answer: dict[str, Any] = json.loads(line)
                return answer
        return {"error": "it ended"}
