"""Fixtures for all tests: the folder of real captures, and Qt without a display."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import devices

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


ON_EACH_DEVICE = ("delegate/", "render/", "sim/", "kernels/", "test_")
"""Tests that ask for any device, by where they are: they run on each that is here."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """pytest's hook: name the device in the test's own name."""
    place = metafunc.definition.path.relative_to(Path(__file__).parent).as_posix()
    says = {"on_device", "scenes_on_device"} | (
        {"device"} if place.startswith("kernels/") else set()
    )
    if place.startswith(ON_EACH_DEVICE) and not says & set(metafunc.fixturenames):
        metafunc.parametrize("any_device", devices.here(), indirect=True)


@pytest.fixture(scope="session", autouse=True)
def any_device(request: pytest.FixtureRequest) -> Iterator[str]:
    """What "auto" means to a test that does not say on which device it runs: each that is here."""
    name = getattr(request, "param", "auto")
    with pytest.MonkeyPatch.context() as patch:
        if name != "auto":
            patch.setattr("usdsplat.kernels.devices.automatic", lambda *_: (name, ""))
        yield name
