"""Fixture with Chromium, if it is installed; one per test module."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.chromium import WITHOUT_GPU, chromium
from tests.preview.web.wire import Host


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window."""
    with chromium(*WITHOUT_GPU) as found:
        yield found


@pytest.fixture
def host() -> Iterator[Host]:
    host = Host()
    yield host
    host.close()
