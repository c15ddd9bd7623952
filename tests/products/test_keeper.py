"""Tests of stages that stay open between tasks."""

from __future__ import annotations

import json

import pytest

from tests.cli.conftest import ball
from usdsplat import formats
from usdsplat.cli.worker import carried_out
from usdsplat.products.keeper import EngineKeeper

pytestmark = pytest.mark.usefixtures("compiled")


@pytest.fixture
def keeper():
    """A keeper that is closed at the end."""
    found = EngineKeeper()
    yield found
    found.close()


def splats(keeper, *words):
    """The number of splats that a task draws."""
    flags = ("--resolution", "32x32", "--device", "cpu", "--json", "-q")
    result = carried_out(list(map(str, ("render", *words, *flags))), keeper)
    assert result.status == 0, result.err
    return json.loads(result.out)["pictures"][0]["splats"]


def test_a_stage_stays_open_for_the_next_task(keeper, shot, tmp_path):
    """Oracle: the engine is the same object, and pictures have all splats."""
    first = splats(keeper, shot, "-o", tmp_path / "a.exr", "--frames", "1")
    engine = keeper._open.engine
    assert splats(keeper, shot, "-o", tmp_path / "b.exr", "--frames", "3") == first > 0
    assert keeper._open.engine is engine


def test_a_capture_that_changed_is_read_again(keeper, capture, tmp_path):
    """Oracle: the number of its splats."""
    assert splats(keeper, capture, "-o", tmp_path / "a.png") == 300
    formats.write(ball(200, 7), capture)
    assert splats(keeper, capture, "-o", tmp_path / "a.png") == 200
