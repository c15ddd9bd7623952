"""Tests of the editors of all knobs."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from typing import Literal

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import knob, knobs
from usdsplat.preview.knob_model import editors_of, label, with_value
from usdsplat.preview.values import DisplaySettings
from usdsplat.render.settings import RenderSettings
from usdsplat.sim.parameters import GROUPS, INSTANCED

SETTINGS = (RenderSettings, DisplaySettings)
EVERYTHING = (*SETTINGS, *GROUPS.values(), *INSTANCED.values())


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One knob of each sort."""

    budget: int | None = knob(None, "how many", range=(1, 2**31 - 1))
    life: float = knob(math.inf, "how long", unit="s", range=(0.0, math.inf))
    names: tuple[str, ...] = knob((), "who")
    rank: Literal[1, 2] = knob(1, "which")
    tint: tuple[float, float, float] = knob((1.0, 1.0, 1.0), "of it", usd_type="color3f")
    divisions: tuple[int, int, int] = knob((2, 2, 2), "of it", range=(2, 16))
    points: tuple[tuple[float, float, float], ...] = knob((), "where")
    plain: int = 3


def editor(instance, name):
    return {each.name: each for each in editors_of(instance)}[name]


@pytest.mark.parametrize("cls", EVERYTHING, ids=lambda cls: cls.__name__)
def test_every_knob_has_an_editor_that_json_can_hold(cls):
    """Oracle: strict JSON, which has no infinity; and the declared knobs but lists of vectors."""
    made = editors_of(cls())
    lists = {"DeformParameters": {"points"}, "AccretionParameters": {"ramp", "tints"}}
    left = lists.get(cls.__name__, set())
    assert {each.name for each in made} == {item.name for item in knobs(cls)} - left
    for each in made:
        text = json.dumps(asdict(each), allow_nan=False)
        assert json.loads(text)["help"]
        low, high = each.soft_range
        assert low < high and each.step > 0
        if each.kind in ("int", "float") and each.value is not None:
            assert low <= each.value <= high
        assert each.minimum is None or low >= each.minimum or each.kind not in ("int", "float")


@pytest.mark.parametrize("cls", EVERYTHING, ids=lambda cls: cls.__name__)
def test_what_an_editor_holds_is_taken_back(cls):
    """Oracle: the same settings after each of their values went through JSON."""
    settings = cls()
    for each in editors_of(settings):
        assert with_value(settings, each.name, json.loads(json.dumps(each.value))) == settings


@pytest.mark.parametrize("cls", SETTINGS, ids=lambda cls: cls.__name__)
def test_settings_are_under_headings(cls):
    """Oracle: a person's expectation: nothing is under "Other" that has a better place."""
    assert "Other" not in {each.group for each in editors_of(cls())}


def test_a_changed_value_leaves_the_rest():
    """Oracle: each field compared."""
    before = RenderSettings(samples=16)
    after = with_value(before, "sh_degree", 2)
    changed = [f.name for f in fields(after) if getattr(after, f.name) != getattr(before, f.name)]
    assert changed == ["sh_degree"] and after.sh_degree == 2


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sh_degree", 9),
        ("sh_degree", 1.5),
        ("sh_degree", True),
        ("sh_degree", None),
        ("sorting", "sideways"),
        ("sorting", ["auto"]),
        ("filter_width", math.nan),
        ("filter_width", "wide"),
        ("motion_blur", 1),
        ("no_such", 1),
        ("ocio_config", 3),
    ],
)
def test_a_wrong_value_is_refused_in_a_sentence(name, value):
    """Oracle: the sentence has the shape of all of them."""
    with pytest.raises(UsageError, match=r"found .+, expected .+"):
        with_value(RenderSettings(), name, value)


def test_none_stands_for_no_limit_and_for_automatic():
    """Oracle: the values that the knobs declare."""
    sample = Sample(life=2.0, budget=5)
    assert editor(sample, "life").none_label == "unlimited"
    assert with_value(sample, "life", None).life == math.inf
    assert editor(Sample(), "life").value is None
    assert editor(sample, "budget").none_label == "automatic"
    assert with_value(sample, "budget", None).budget is None


def test_kinds_follow_from_types():
    """Oracle: what each sort of value is to a person."""
    made = {each.name: each for each in editors_of(Sample(names=("a", "b")))}
    kinds = {name: each.kind for name, each in made.items()}
    assert kinds == {
        "budget": "int",
        "life": "float",
        "names": "text",
        "rank": "choice",
        "tint": "color",
        "divisions": "vector",
    }
    assert made["names"].value == "a, b"
    assert made["rank"].value == "1" and made["rank"].choices == ("1", "2")
    assert made["divisions"].is_whole and not made["tint"].is_whole
    assert with_value(Sample(), "names", "a,  b,").names == ("a", "b")
    assert with_value(Sample(), "rank", "2").rank == 2
    assert with_value(Sample(), "divisions", [3, 4, 5]).divisions == (3, 4, 5)


def test_a_slider_spans_what_is_of_use():
    """Oracle: a person's expectation of some: all of a small range, some of a large one."""
    settings = RenderSettings()
    assert editor(settings, "sh_degree").soft_range == (0.0, 4.0)
    low, high = editor(settings, "samples").soft_range
    assert low == 1.0 and 16.0 <= high <= 256.0
    assert editor(with_value(settings, "samples", 4000), "samples").soft_range[1] == 4000.0


@pytest.mark.parametrize(
    ("name", "text"),
    [("sh_degree", "SH degree"), ("color_mode", "Colour mode"), ("k_max", "k max")],
)
def test_labels_are_words(name, text):
    """Oracle: how a person writes them."""
    assert label(name) == text
