"""The small capture and shot that the commands are tested with."""

from __future__ import annotations

from tests.cli.conftest import capture, compiled, run, run_json, shot

__all__ = ["capture", "compiled", "run", "run_json", "shot"]
