"""Tests that run every example and its check."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path, tmp_path):
    """Oracle: the example's own check, which reads back what its main wrote."""
    spec = importlib.util.spec_from_file_location(f"example_{path.stem}", path)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    example.check(example.main(tmp_path))


def test_there_are_examples():
    """Oracle: a glob that finds nothing would test nothing."""
    assert len(EXAMPLES) >= 7
