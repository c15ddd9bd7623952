"""A stage for each test; prims die with their stage, so tests hold it."""

from __future__ import annotations

import pytest
from pxr import Usd

import usdsplat.schema  # noqa: F401 - before the first prim of the process


@pytest.fixture
def stage() -> Usd.Stage:
    """An empty stage in memory."""
    return Usd.Stage.CreateInMemory()
