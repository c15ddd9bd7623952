"""Tests of the cache of nodes: what is read, kept and dropped."""

from __future__ import annotations

import queue
import threading

import pytest

from tests.render.rendering import random_cloud
from usdsplat.core.errors import StageError, UsageError
from usdsplat.render.lod.cache import NodeCache, Request

SIZE = 4 * 250 * (3 + 3 + 4 + 1 + 3 * 16)
"""Bytes of the clouds below."""


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def cache(clock):
    made = NodeCache(clock=clock)
    yield made
    made.close()


class Source:
    """Clouds by name; counts its reads."""

    def __init__(self):
        self.reads = []

    def wanting(self, *names):
        return {name: Request(read=lambda name=name: self.read(name), size=SIZE) for name in names}

    def read(self, name):
        self.reads.append(name)
        if name.startswith("bad"):
            raise StageError(name, "nothing", "splats")
        return random_cloud(len(name))


def get(cache, source, *names, limit=100 * SIZE, lifetime=5.0):
    return cache.get(source.wanting(*names), limit=limit, lifetime=lifetime)


def test_what_is_in_memory_is_not_read_again(cache):
    """Oracle: the number of reads, and identity."""
    source = Source()
    first = get(cache, source, "a", "b")
    again = get(cache, source, "b", "c")
    assert again["b"] is first["b"] and sorted(source.reads) == ["a", "b", "c"]
    assert cache.bytes == 3 * SIZE


def test_the_least_recently_used_make_room(cache):
    """Oracle: the order of use, by hand."""
    source = Source()
    for name in ("a", "b", "c", "a", "d"):
        get(cache, source, name, limit=3 * SIZE)
    assert "b" not in cache and all(name in cache for name in "acd")
    get(cache, source, "e", "f", limit=3 * SIZE)
    assert "d" in cache and cache.bytes == 3 * SIZE


def test_the_bytes_are_those_of_the_splats_in_memory(cache, clock):
    """Oracle: the sum over the names that are found in memory, after reads, errors, drops by age
    and by the limit, and the end."""
    source, names = Source(), "abcdef"
    for step, (wanted, limit) in enumerate(
        [("ab", 9), ("c", 2), ("ad", 3), ("ef", 9), ("b", 9), ("bcdef", 5)]
    ):
        clock.now = 2.0 * step
        get(cache, source, *wanted, *(["bad"] if step == 2 else []), limit=limit * SIZE)
        assert cache.bytes == SIZE * sum(name in cache for name in names)
    cache.close()
    assert cache.bytes == 0


def test_what_is_wanted_makes_no_room(cache):
    """Oracle: all that one request wants is returned, although it fills the limit."""
    source = Source()
    get(cache, source, "a", "b", limit=2 * SIZE)
    found = get(cache, source, "b", "c", limit=2 * SIZE)
    assert set(found) == {"b", "c"} and source.reads.count("b") == 1


def test_what_was_not_used_for_a_lifetime_is_dropped(cache, clock):
    """Oracle: the clock."""
    source = Source()
    get(cache, source, "a", "b")
    clock.now = 4.0
    get(cache, source, "a")
    clock.now = 8.0
    get(cache, source, "c")
    assert "a" in cache and "b" not in cache


def test_a_limit_that_is_too_small_says_what_is_needed(cache):
    """Oracle: by hand; nothing is read."""
    source = Source()
    with pytest.raises(UsageError, match="--node-memory: found 0 MiB, expected at least 1 MiB"):
        get(cache, source, "a", "b", limit=2 * SIZE - 1)
    assert source.reads == []


def test_an_error_is_a_result_and_is_kept(cache, clock):
    """Oracle: the error; it is not tried again before it is old."""
    source = Source()
    for _ in range(2):
        found = get(cache, source, "bad", "a")
        assert isinstance(found["bad"], StageError) and len(found["a"]) == 250
    assert source.reads.count("bad") == 1
    clock.now = 6.0
    get(cache, source, "a")
    get(cache, source, "bad")
    assert source.reads.count("bad") == 2


def test_another_error_ends_the_request_and_is_not_kept(cache):
    """Oracle: the exception; the next request reads again."""
    tries = []

    def read():
        tries.append(1)
        raise RuntimeError("a bug")

    for _ in range(2):
        with pytest.raises(RuntimeError, match="a bug"):
            cache.get({"x": Request(read=read, size=1)}, limit=10, lifetime=1.0)
    assert len(tries) == 2


def test_two_threads_that_want_the_same_read_it_once(cache):
    """Oracle: the number of reads; the first one waits until the second has asked."""
    asked, reads = threading.Event(), []

    def read():
        reads.append(1)
        assert asked.wait(10)
        return random_cloud(1)

    wanted = {"x": Request(read=read, size=SIZE)}
    found = []

    def ask():
        found.append(cache.get(wanted, limit=SIZE, lifetime=1.0)["x"])

    threads = [threading.Thread(target=ask) for _ in range(2)]
    for thread in threads:
        thread.start()
    while len(cache._reading) == 0:
        pass
    asked.set()
    for thread in threads:
        thread.join()
    assert len(reads) == 1 and found[0] is found[1]


def test_a_closed_cache_is_empty_and_has_no_threads(cache):
    """Oracle: the list of threads, of which others than this cache's may have begun before."""
    before = set(threading.enumerate())
    source = Source()
    get(cache, source, "a")
    begun = set(threading.enumerate()) - before
    assert begun and all(each.name.startswith("node") for each in begun)
    cache.close()
    assert cache.bytes == 0 and "a" not in cache
    assert begun.isdisjoint(threading.enumerate())
    assert len(get(cache, source, "a")["a"]) == 250


def test_what_is_read_ahead_makes_no_room_for_what_is_wanted(cache):
    """Oracle: by hand; "a" is the least recently used, but is to be read ahead."""
    source = Source()
    get(cache, source, "a", "b", limit=2 * SIZE)
    cache.get(source.wanting("c"), limit=2 * SIZE, lifetime=5.0, ahead=source.wanting("a"))
    assert "a" in cache and "b" not in cache and "c" in cache


def test_a_thread_that_waits_for_a_closed_cache_gets_a_sentence(cache):
    """Oracle: the exception. Four threads read, so the fifth request is cancelled by closing."""
    go, errors = threading.Event(), []

    def blocked():
        assert go.wait(20)
        return random_cloud(1)

    def ask():
        try:
            wanted = {name: Request(read=blocked, size=SIZE) for name in "abcde"}
            cache.get(wanted, limit=9 * SIZE, lifetime=1.0)
        except BaseException as error:
            errors.append(error)

    asking = threading.Thread(target=ask)
    asking.start()
    while len(cache._reading) < 5:
        pass
    closing = threading.Thread(target=cache.close)
    closing.start()
    while cache._pool is not None or not cache._reading["e"].cancelled():
        pass
    go.set()
    closing.join()
    asking.join()
    (error,) = errors
    assert isinstance(error, UsageError) and "engine: found one that was closed" in str(error)


def test_what_is_asked_for_ahead_is_used(cache, clock):
    """Oracle: the clock: "a" was asked for ahead 4 seconds ago, "b" never again."""
    source = Source()
    get(cache, source, "a", "b")
    clock.now = 4.0
    cache.get({}, limit=9 * SIZE, lifetime=5.0, ahead=source.wanting("a"))
    clock.now = 8.0
    get(cache, source, "c")
    assert "a" in cache and "b" not in cache


def test_what_is_read_ahead_arrives_or_is_cancelled(cache):
    """Oracle: the reads. Four threads read; what waits for one is cancelled by the next request,
    and what that one wants comes before the rest of what it reads ahead."""
    source, go = Source(), threading.Event()

    def blocked(name):
        assert go.wait(20)
        return source.read(name)

    some = {n: Request(read=lambda n=n: blocked(n), size=SIZE) for n in "abcdefgh"}
    assert cache.get({}, limit=100 * SIZE, lifetime=9.0, ahead=some) == {}
    assert cache.is_reading
    threading.Timer(0.2, go.set).start()
    ahead = {n: some[n] for n in "efg"}
    found = cache.get({"h": some["h"]}, limit=100 * SIZE, lifetime=9.0, ahead=ahead)
    assert len(found["h"]) == 250
    get(cache, source, *"efg")
    get(cache, source, *"abcd")  # they were being read
    assert sorted(source.reads) == sorted("abcdefgh")
    assert not cache.is_reading


def test_reads_that_nobody_waits_for_are_told(cache):
    """Oracle: by hand: two reads ahead, one of which fails, and one that is waited for."""
    source, told = Source(), queue.Queue()
    cache.on_read = lambda: told.put(cache.reads)
    cache.get({}, limit=9 * SIZE, lifetime=9.0, ahead=source.wanting("a", "bad"))
    assert told.get(timeout=20) <= 2 and told.get(timeout=20) == 2
    get(cache, source, "a", "c")
    cache.close()
    assert cache.reads == 2 and told.empty()


def test_what_was_to_be_read_ahead_is_not_read_if_it_is_not_asked_for_again(cache):
    """Oracle: the reads. Four threads read, so "e" to "h" wait, of which only "h" is wanted."""
    source, go = Source(), threading.Event()

    def blocked(name):
        assert go.wait(20)
        return source.read(name)

    some = {n: Request(read=lambda n=n: blocked(n), size=SIZE) for n in "abcdefgh"}
    cache.get({}, limit=100 * SIZE, lifetime=9.0, ahead=some)
    cache.get({}, limit=100 * SIZE, lifetime=9.0, ahead={"h": some["h"]})
    go.set()
    get(cache, source, "h")
    assert set("h") <= set(source.reads) <= set("abcdh")


def test_what_another_thread_waits_for_is_not_cancelled(cache):
    """Oracle: its result. Four threads read; the fifth request waits for one, and another thread
    asks for it ahead, and then for nothing."""
    go, found = threading.Event(), []

    def blocked():
        assert go.wait(20)
        return random_cloud(1)

    wanted = {name: Request(read=blocked, size=SIZE) for name in "abcde"}
    asking = threading.Thread(
        target=lambda: found.append(cache.get(wanted, limit=9 * SIZE, lifetime=1.0))
    )
    asking.start()
    while len(cache._reading) < 5:
        pass
    for ahead in ({"e": wanted["e"]}, {}):
        assert cache.get({}, limit=9 * SIZE, lifetime=1.0, ahead=ahead) == {}
    go.set()
    asking.join()
    assert set(found[0]) == set("abcde")


def test_what_is_dropped_is_gone_at_once_also_if_it_is_being_read(cache):
    """Oracle: the bytes and the reads. Four threads read, so "e" is cancelled; a caller that waits
    for "a" gets it, but it is not kept. What is asked for again is kept."""
    source, go, found = Source(), threading.Event(), []
    get(cache, source, "x", "y")
    cache.drop(lambda key: key == "x")
    assert "x" not in cache and cache.bytes == SIZE

    def blocked(name):
        assert go.wait(20)
        return source.read(name)

    some = {n: Request(read=lambda n=n: blocked(n), size=SIZE) for n in "abcde"}
    asking = threading.Thread(
        target=lambda: found.append(cache.get({"a": some["a"]}, limit=9 * SIZE, lifetime=9.0))
    )
    asking.start()
    while not cache.is_reading:
        pass
    cache.get({}, limit=9 * SIZE, lifetime=9.0, ahead={n: some[n] for n in "bcde"})
    cache.drop(lambda key: key in "abe")
    cache.get({}, limit=9 * SIZE, lifetime=9.0, ahead={n: some[n] for n in "bcd"})
    go.set()
    asking.join()
    get(cache, source, *"bcd", "y")
    assert "a" in found[0] and "a" not in cache and "e" not in cache
    assert cache.bytes == 4 * SIZE and sorted(source.reads) == sorted("xyabcd")
