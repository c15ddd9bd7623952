"""The small capture and shot that the commands are tested with, and a process without a past."""

from __future__ import annotations

from tests.cli.conftest import _a_program_of_usual_size, capture, compiled, run, run_json, shot

__all__ = ["_a_program_of_usual_size", "capture", "compiled", "run", "run_json", "shot"]
