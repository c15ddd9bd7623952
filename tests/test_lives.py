"""Tests of the lists in CONTRIBUTING: the lives of a frame, of an edit, and of a parameter."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from pxr import Usd

from tests.render.rendering import random_cloud
from usdsplat import formats, schema
from usdsplat.cli.main import main
from usdsplat.delegate.engine import Engine

ROOT = Path(__file__).parents[1]
PACKAGE = "usdsplat."


def told(heading: str) -> list[str]:
    """The names of a numbered list of CONTRIBUTING, in its order."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    section = text.split(f"## {heading}\n")[1].split("\n## ")[0]
    return re.findall(r"^\d+\. `([\w.]+)`: ", section, re.MULTILINE)


def called_by(action: Callable[[], Any]) -> list[str]:
    """The functions of the package that are called, each once, in the order of first calls."""
    names: dict[str, None] = {}

    def note(frame: FrameType, event: str, _: Any) -> None:
        module = str(frame.f_globals.get("__name__", ""))
        if event == "call" and module.startswith(PACKAGE):
            names.setdefault(f"{module.removeprefix(PACKAGE)}.{frame.f_code.co_qualname}")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(before)
    return list(names)


def assert_lived(heading: str, called: list[str]) -> None:
    """What is told is what was called, in that order."""
    life = told(heading)
    assert len(life) > 5
    assert [name for name in called if name in life] == life


@pytest.fixture
def stage() -> Usd.Stage:
    """A stage with one field."""
    made = Usd.Stage.CreateInMemory()
    schema.author(made, "/Field", random_cloud(1))
    return made


def test_a_frame_lives_as_it_is_told(stage: Usd.Stage) -> None:
    """Oracle: the interpreter, which says what it calls."""
    with Engine(stage, device="cpu") as engine:
        view = engine.view(resolution=(48, 32))
        assert_lived("The life of a frame", called_by(lambda: engine.picture(view)))


def test_an_edit_lives_as_it_is_told(stage: Usd.Stage) -> None:
    """Oracle: the interpreter, which says what it calls."""
    with Engine(stage, device="cpu") as engine:
        view = engine.view(resolution=(48, 32))
        engine.picture(view)
        opacities = stage.GetPrimAtPath("/Field").GetAttribute("opacities")

        def edit() -> None:
            opacities.Set([0.5] * len(opacities.Get()))
            engine.picture(view)

        assert_lived("The life of an edit", called_by(edit))


def test_a_parameter_lives_as_it_is_told(tmp_path: Path) -> None:
    """Oracle: the interpreter, which says what it calls."""
    formats.write(random_cloud(2), tmp_path / "scan.ply")
    shot, out = tmp_path / "shot.usda", tmp_path / "bake.usda"
    assert (
        main(["simulate", "--preset", "dissolve", str(tmp_path / "scan.ply"), "-o", str(shot)]) == 0
    )
    words = ["simulate", str(shot), "-o", str(out), "--frames", "1:2", "--set", "sim:substeps=2"]
    assert_lived("The life of a parameter", called_by(lambda: main(words)))
