"""Tests of a simulation in the web view, in a headless browser."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.preview.simulating.hosts import shot
from tests.preview.web.seats import PATIENCE, Seat
from tests.sim.stage.stages import FIELD, SIM
from usdsplat import schema
from usdsplat.preview.document import Document
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.values import Event

LAST, ENDLESS = 12, 3000
"""Frames: played in half a second, and in two minutes, in which any browser clicks in time."""
STILL = {"particles:enabled": True, "particles:drag": 0.0, "particles:gravity": (0.0, 0.0, 0.0)}


@pytest.fixture(scope="module")
def seat(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seat]:
    """Before a ball of splats that floats, until somebody turns gravity on."""
    stage = shot(tmp_path_factory.mktemp("shot"), STILL, last=LAST)
    stage.RemovePrim("/World/Stick")
    stage.SetEditTarget(stage.GetSessionLayer())

    def opened(publish: Callable[[Event], None]) -> Document:
        document = Document(stage, publish=publish)
        document.simulation = Runner(document)
        return document

    seat = Seat(browser, opened)
    seat.rested()
    seat.page.locator('.group:has([data-name="particles:gravity"]) > summary').click()
    yield seat
    seat.close()


def lowest(seat: Seat, frame: float) -> float:
    """Of the splats' centres at a frame."""
    found: list[float] = []
    seat.ask(
        lambda document: found.append(
            float(schema.fetch(document.stage.GetPrimAtPath(FIELD), frame).positions[:, 1].min())
        )
    )
    return found[0]


def wait_for_status(seat: Seat, *words: str) -> None:
    """Until the panel says all of them."""
    seat.page.wait_for_function(
        """(words) => {
          const text = document.getElementById("simulation-status").textContent;
          return words.every((word) => text.includes(word));
        }""",
        arg=list(words),
    )


def frame_of(seat: Seat) -> int:
    """What the panel says."""
    found = re.search(r"frame (\d+)", seat.page.locator("#simulation-status").inner_text())
    assert found is not None
    return int(found[1])


def test_a_simulation_runs_is_paused_turned_and_reset(seat: Seat, tmp_path: Path) -> None:
    """Oracle: free fall: nothing moves without gravity, and all falls once it is there."""
    page = seat.page
    wait_for_status(seat, "ready")
    page.get_by_role("button", name="Step", exact=True).click()
    wait_for_status(seat, "paused", "frame 1")
    page.get_by_role("button", name="Step", exact=True).click()
    wait_for_status(seat, "paused", "frame 2")
    assert lowest(seat, 2) == pytest.approx(lowest(seat, 1), abs=1e-6)

    gravity = page.locator('.knob[data-name="particles:gravity"] input').nth(1)
    gravity.fill("-24")
    gravity.press("Enter")
    page.wait_for_function(
        """() => !document.querySelector('.knob[data-name="particles:gravity"] .reset').hidden"""
    )
    page.get_by_role("button", name="Run", exact=True).click()
    wait_for_status(seat, "paused", f"frame {LAST}")
    assert lowest(seat, LAST) < lowest(seat, 2) - 0.5
    number = seat.rested(accept=lambda picture: picture.state.time == LAST)
    _, pixels = seat.canvas()
    assert np.array_equal(pixels, seat.picture(number).image)
    seat.shoot(tmp_path / "simulation.png")

    page.get_by_role("button", name="Reset", exact=True).click()
    wait_for_status(seat, "ready")
    assert seat.errors == []


def test_it_can_be_paused_in_between(seat: Seat) -> None:
    """Oracle: it says that it is paused at a frame before the last, and goes on from there."""
    page = seat.page
    seat.ask(lambda document: document.stage.SetEndTimeCode(ENDLESS))
    page.get_by_role("button", name="Run", exact=True).click()
    wait_for_status(seat, "frame")
    page.get_by_role("button", name="Pause", exact=True).click()
    wait_for_status(seat, "paused")
    paused = frame_of(seat)
    assert 1 <= paused < ENDLESS
    page.get_by_role("button", name="Run", exact=True).click()
    page.wait_for_function(
        """(last) => {
          const text = document.getElementById("simulation-status").textContent;
          const found = /frame (\\d+)/.exec(text);
          return found && Number(found[1]) > last;
        }""",
        arg=paused,
    )
    page.get_by_role("button", name="Reset", exact=True).click()
    wait_for_status(seat, "ready")
    seat.ask(lambda document: document.stage.SetEndTimeCode(LAST))
    assert seat.errors == []


def test_an_edit_is_undone(seat: Seat) -> None:
    """Oracle: the attribute's value, as authored, edited, and taken back."""

    def gravity() -> list[float]:
        found: list[Any] = []
        seat.ask(
            lambda document: found.append(
                document.stage.GetPrimAtPath(SIM).GetAttribute("splatSim:particles:gravity").Get()
            )
        )
        return list(found[0])

    now = gravity()
    field = seat.page.locator('.knob[data-name="particles:gravity"] input').nth(1)
    field.fill("3")
    field.press("Enter")
    deadline = time.monotonic() + PATIENCE
    while gravity() != [0.0, 3.0, 0.0]:
        assert time.monotonic() < deadline
    seat.page.get_by_role("button", name="Undo", exact=True).click()
    seat.page.get_by_text("Undid").wait_for()
    assert gravity() == now
    assert seat.errors == []
