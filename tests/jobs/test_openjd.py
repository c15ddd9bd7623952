"""Tests of templates of Open Job Description. Oracle of all: by hand, from the specification."""

from __future__ import annotations

from pathlib import Path

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.jobs.bakes import bake_job, with_sheet
from usdsplat.jobs.frames import render_job
from usdsplat.jobs.openjd import Bundle, Source, template_of
from usdsplat.products.tiles import Tiling

STAGE = Source(name="Stage", path="assets/a.usd", is_folder=False, text="stage")


def bundle(frames=(), chunk=1):
    return Bundle(folder=Path("b"), source=STAGE, results="pictures", frames=frames, chunk=chunk)


@pytest.mark.parametrize("uses_gpu", [True, False])
def test_tasks_ask_for_the_device_and_the_memory_that_they_use(uses_gpu):
    """Oracle: all steps open the device, that which joins tiles too; memory is in MiB."""
    job = render_job(
        ("render", STAGE.word()), (1.0, 2.0), name="a", chunk=1, tiling=Tiling(2, 1),
        uses_gpu=uses_gpu, memory=3 << 30,
    )  # fmt: skip
    template = template_of(job, bundle((1.0, 2.0)))
    expected = [{"name": "amount.worker.gpu", "min": 1}] if uses_gpu else []
    expected += [{"name": "amount.worker.memory", "min": 3072}]
    for step in template["steps"]:
        assert step["hostRequirements"] == {"amounts": expected}
        entered = step["stepEnvironments"][0]["script"]["actions"]["onEnter"]
        assert entered["args"] == ["compile", "--device", "cuda" if uses_gpu else "cpu"]


@pytest.mark.parametrize(
    ("frames", "extensions", "space"),
    [
        ((3.0, 4.0), ["TASK_CHUNKING"], {"type": "CHUNK[INT]", "range": "{{Param.Frames}}"}),
        ((3.0, 5.0), None, {"type": "STRING", "range": ["3,5"]}),
        ((3.5, 4.5), None, {"type": "STRING", "range": ["3.5-4.5"]}),
    ],
    ids=str,
)
def test_frames_without_gaps_are_a_range_that_the_farm_divides(frames, extensions, space):
    """Oracle: as above."""
    job = render_job(("render",), frames, name="a", chunk=2, tiling=None)
    template = template_of(job, bundle(frames, chunk=2))
    (found,) = template["steps"][0]["parameterSpace"]["taskParameterDefinitions"]
    assert template.get("extensions") == extensions
    assert found.items() >= {"name": "Frames", **space}.items()


def test_only_the_first_words_may_refer_to_parameters():
    """Oracle: the sentence for a text that a template would read as a reference."""
    good = ("simulate", STAGE.word(), "--output={{Param.OutputFolder}}/b")
    template_of(bake_job(good, (1.0,), chunk=None), bundle())
    for word in ("--set={{Param.Stage}}", "--output={{Param.OutputFolder}}/{{x}}", "}}", "a\nb"):
        job = bake_job(("simulate", word), (1.0,), chunk=None)
        with pytest.raises(UsageError, match="a text without"):
            template_of(job, bundle())


@pytest.mark.parametrize("name", ["a{{b", "{{Param.Stage}}", "}}", "{" * 200, "{{{x}}}", "{a}"])
def test_braces_in_the_name_of_a_stage_are_no_references(name):
    """Oracle: the parser of Open Job Description."""
    model = pytest.importorskip("openjd.model")
    job = render_job(("render",), (1.0, 2.0), name=f"render {name}", chunk=1, tiling=None)
    template = template_of(job, bundle((1.0, 2.0)))
    read = model.decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    assert str(read.name) == template["name"] and template["name"].startswith("usdsplat render ")


def test_a_step_of_too_many_tasks_is_refused_with_advice_where_it_helps():
    """Oracle: the sentences: frames that are no range, and bakes of a wedge."""
    frames = tuple(2.0 * n for n in range(1100))
    job = render_job(("render",), frames, name="a", chunk=1, tiling=None)
    with pytest.raises(UsageError) as refused:
        template_of(job, bundle(frames))
    assert str(refused.value).endswith(
        "found 1100 tasks in a step, expected at most 1024, by a larger --chunk"
    )
    job = bake_job(("simulate",), (1.0, 2.0), bakes=1100, chunk=None)
    with pytest.raises(UsageError, match=r"found 1100 bakes in a step, expected at most 1024$"):
        template_of(job, bundle())


def test_parts_of_bakes_follow_each_other_and_the_sheet_follows_all():
    """Oracle: the order of the steps; chunks end at the frames that divide the range, and the last
    one at the end of the bakes."""
    frames = tuple(map(float, range(1, 8)))
    job = with_sheet(bake_job(("simulate",), frames, bakes=3, chunk=3), ("simulate", "--resume"))
    assert [step.name for step in job.steps] == ["part 1", "part 2", "part 3", "sheet"]
    assert [step.after for step in job.steps] == [(), ("part 1",), ("part 2",), ("part 3",)]
    words = [task.words for task in job.tasks()]
    assert len(words) == 3 * 3 + 1
    assert words[0] == ("simulate", "--resume", "--combination=1", "--until=3.0")
    assert words[8] == ("simulate", "--resume", "--combination=3")
    needs = {task.name: [each.name for each in before] for task, before in job.needs().items()}
    assert needs["part 2, bake 3"] == ["part 1, bake 3"]
    assert needs["sheet"] == [f"part 3, bake {n}" for n in (1, 2, 3)]
