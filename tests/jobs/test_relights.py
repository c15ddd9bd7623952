"""Tests of the division of a relighting into tasks."""

from __future__ import annotations

from pathlib import Path

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.jobs.openjd import Bundle, Source, template_of
from usdsplat.jobs.relights import relight_job

INPUTS = Source(name="Inputs", path="assets", is_folder=True, text="inputs")


def test_the_layer_is_written_when_all_parts_are_lit_and_without_a_gpu():
    """Oracle: by hand."""
    job = relight_job(("relight", "a.usd"), parts=2, uses_gpu=True, finishes=True)
    found = {task.words: len(before) for task, before in job.needs().items()}
    assert found == {
        ("relight", "a.usd", "--part=1/2"): 0,
        ("relight", "a.usd", "--part=2/2"): 0,
        ("relight", "a.usd"): 2,
    }
    assert [task.uses_gpu for task in job.tasks()] == [True, True, False]
    alone = relight_job(("relight", "a.usd"), parts=1)
    assert [task.name for task in alone.tasks()] == ["light, part 1/1"]


def bundle_of(*words, parts=2):
    job = relight_job(("relight", INPUTS.word("1/a.usd"), *words), parts=parts)
    return template_of(job, Bundle(folder=Path("b"), source=INPUTS, results="layer"))


def test_only_the_picture_of_the_set_may_be_an_input():
    """Oracle: by hand; other flags with a reference, and other references, are refused."""
    word = f"--captured-hdri={INPUTS.word('2/set.exr')}"
    (step,) = bundle_of(word)["steps"]
    assert step["script"]["actions"]["onRun"]["args"][2] == word
    for other in (
        f"--session-layer={INPUTS.word('2/a')}", "--captured-hdri={{Param.Other}}/a",
        f"{word}{{{{x}}}}",
    ):  # fmt: skip
        with pytest.raises(UsageError, match="a text without"):
            bundle_of(other)


def test_too_many_parts_are_refused_with_advice():
    """Oracle: the sentence."""
    with pytest.raises(UsageError, match=r"found 1,?025 tasks in a step, .*by a larger --chunk"):
        bundle_of(parts=1025)
