"""Tests of jobs as values: their tasks, and the tasks that each of them waits for."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from usdsplat.core.errors import UsageError
from usdsplat.images.frame_numbers import parse_frames
from usdsplat.jobs.frames import chunk_texts, render_job, shared_out
from usdsplat.jobs.job import Job, Parameter, Slot, Step
from usdsplat.products.tiles import Tiling


def test_a_step_has_a_task_for_each_combination():
    """Oracle: the combinations by hand."""
    a, b = Parameter(name="a", values=("1", "2")), Parameter(name="b", values=("x",))
    step = Step(name="go", command=("run", Slot("--a", "a"), Slot("--b", "b")), space=(a, b))
    assert [task.words for task in step.tasks()] == [
        ("run", "--a=1", "--b=x"),
        ("run", "--a=2", "--b=x"),
    ]
    assert [task.name for task in step.tasks()] == ["go, a 1, b x", "go, a 2, b x"]


def test_a_task_waits_for_those_that_agree_with_it():
    """Oracle: by hand: joining frames 1-2 needs the tiles of these frames only."""
    job = render_job(("render", "a.usd"), (1.0, 2.0, 3.0), name="a", chunk=2, tiling=Tiling(2, 1))
    needs = {task.name: [each.name for each in before] for task, before in job.needs().items()}
    assert needs == {
        "draw, frames 1-2, tile 1": [],
        "draw, frames 1-2, tile 2": [],
        "draw, frames 3, tile 1": [],
        "draw, frames 3, tile 2": [],
        "join, frames 1-2": ["draw, frames 1-2, tile 1", "draw, frames 1-2, tile 2"],
        "join, frames 3": ["draw, frames 3, tile 1", "draw, frames 3, tile 2"],
    }


def test_steps_without_a_common_parameter_follow_each_other_as_a_whole():
    """Oracle: by hand."""
    parts = Parameter(name="part", values=("1", "2", "3"))
    first = Step(name="first", command=("a", Slot("--part", "part")), space=(parts,))
    job = Job(name="j", steps=(first, Step(name="last", command=("b",), after=("first",))))
    assert {len(before) for task, before in job.needs().items() if task.step == "last"} == {3}


@settings(suppress_health_check=[HealthCheck.too_slow])  # of a busy machine
@given(
    st.lists(st.integers(-200, 200).map(lambda n: n / 4), min_size=1, max_size=40, unique=True),
    st.integers(1, 9),
)
def test_chunks_are_the_frames_in_their_order(frames, chunk):
    """Oracle: `parse_frames`, which reads the texts of all chunks back."""
    texts = chunk_texts(frames, chunk)
    assert [frame for text in texts for frame in parse_frames(text)] == frames
    assert all(len(parse_frames(text)) <= chunk for text in texts)


@settings(suppress_health_check=[HealthCheck.too_slow])  # of a busy machine
@given(st.integers(1, 400), st.integers(1, 9))
def test_workers_end_at_nearly_the_same_time(count, workers):
    """Oracle: workers that take a time of 1 for each frame, and take the next task when they have
    ended one: all end within the time of a frame, but where frames are few, and none takes a task
    that is longer than an eighth of its share, rounded up."""
    frames = tuple(map(float, range(count)))
    parts = shared_out(frames, workers)
    assert tuple(frame for part in parts for frame in part) == frames
    assert max(map(len, parts)) <= -(-count // (8 * workers))
    ends = [0] * workers
    for part in parts:
        ends[ends.index(min(ends))] += len(part)
    assert max(ends) - min(ends) <= 1


def test_a_chunk_has_a_frame():
    """Oracle: the error."""
    with pytest.raises(UsageError, match="--chunk: found 0, expected 1 or more frames"):
        render_job(("render",), (1.0,), name="a", chunk=0, tiling=None)
