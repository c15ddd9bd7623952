"""Tests of a peer in a separate process: requests, errors and processor time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import pytest

from benchmarks.peers.server import Server

PEER = """
import json, subprocess, sys
print("a library says hello", flush=True)
for line in sys.stdin:
    request = json.loads(line)
    if request["do"] == "end":
        break
    if request["do"] == "fail":
        print(json.dumps({"error": "no such thing"}), flush=True)
        continue
    busy = "import sys, time\\nwhile time.process_time() < 0.3: pass\\nsys.stdin.read()"
    child = subprocess.Popen([sys.executable, "-c", busy], stdin=subprocess.PIPE)
    print(json.dumps({"number": 2 * request["number"]}), flush=True)
"""


@pytest.fixture
def server() -> Iterator[Server]:
    """One that doubles numbers, and starts a child that works for 0.3 s of processor time."""
    opened = Server("peer", [sys.executable, "-c", PEER])
    yield opened
    opened.close()


def test_a_peer_answers_what_it_is_asked(server: Server) -> None:
    """Oracle: twice the number; what is no JSON is passed over."""
    assert server.ask(do="double", number=21) == {"number": 42}


def test_a_peer_that_fails_or_ends_is_quoted(server: Server) -> None:
    """Oracle: its words."""
    with pytest.raises(RuntimeError, match="peer: no such thing"):
        server.ask(do="fail")
    with pytest.raises(RuntimeError, match="peer: it ended"):
        server.ask(do="end")
    with pytest.raises(RuntimeError, match="peer: it ended"):
        server.ask(do="double", number=1)


@pytest.mark.skipif(sys.platform != "linux", reason="processor time is read from /proc")
def test_the_processor_time_of_children_counts(server: Server) -> None:
    """Oracle: the child's own clock; the server alone needs a tenth of that."""
    before = server.cpu_seconds()
    server.ask(do="double", number=1)
    patience = time.monotonic() + 60
    while server.cpu_seconds() - before < 0.25:
        assert time.monotonic() < patience, "the child's time was not seen"
        time.sleep(0.02)
