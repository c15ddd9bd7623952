"""Where tests find the real captures, and how they say that they do without; no window is shown."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # no test puts a window before anybody's eyes
DATA = Path(
    os.environ.get("USDSPLAT_TEST_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data"
)


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of real captures, stages and oracles; tests that need it skip visibly without it."""
    if not (DATA / "README.md").is_file():
        pytest.skip(f"no test data at {DATA}; set USDSPLAT_TEST_DATA")
    return DATA
