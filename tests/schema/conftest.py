"""Fixture with a stage for each test. Prims expire with their stage, so tests hold it."""

from __future__ import annotations

import pytest
from pxr import Usd, UsdGeom

from usdsplat.schema import registration

registration.register()  # before the first prim of the process


@pytest.fixture
def stage() -> Usd.Stage:
    """An empty stage in memory that says how it stands and how large it is."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    return stage
