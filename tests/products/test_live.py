"""Tests of the frames that are kept as values."""

from __future__ import annotations

from dataclasses import replace

from tests.delegate.stages import random_cloud
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.products.live import LiveHistory


def frame(time, **clouds):
    """A frame with fields below the root."""
    return LiveClouds(time=time, clouds={f"/{name}": cloud for name, cloud in clouds.items()})


def test_frames_are_found_by_their_time_until_they_are_taken():
    """Oracle: the objects that were put in, in their order."""
    history = LiveHistory({})
    frames = [frame(time, A=random_cloud(int(time))) for time in (1.0, 2.0, 3.0)]
    for each in frames:
        history.put(each)
    assert history.times == (1.0, 2.0, 3.0)
    assert history.at(2.0) is frames[1]
    assert history.at(2.5) is None and history.at(None) is None
    history.forget()
    assert [each.live for each in history.take()] == frames[1:]
    assert history.times == () and history.bytes == 0


def test_arrays_that_are_shared_count_once():
    """Oracle: the bytes of positions and harmonics of the two frames that have new ones."""
    rest = random_cloud(1)
    history = LiveHistory({"/A": rest})
    moved = replace(rest, positions=rest.positions + 1)
    history.put(frame(1.0, A=rest))
    assert history.bytes == 0
    history.put(frame(2.0, A=moved))
    history.put(frame(3.0, A=moved))
    history.put(frame(4.0, A=replace(moved, sh=rest.sh * 2)))
    assert history.bytes == rest.positions.nbytes + rest.sh.nbytes
