"""Fixtures: the small capture and stage of the command tests, and a new process."""

from __future__ import annotations

from tests.cli.conftest import _a_program_of_usual_size, capture, compiled, run, run_json, shot

__all__ = ["_a_program_of_usual_size", "capture", "compiled", "run", "run_json", "shot"]
