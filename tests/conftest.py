"""Fixtures for all tests: the folder of real captures, USD's validators on the stages that tests
write, and Qt without a display."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import devices

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # no test puts a window before anybody's eyes
if "PYTEST_XDIST_WORKER" in os.environ:  # as many workers as cores, also where tests run commands
    os.environ.setdefault("USDSPLAT_THREADS", "1")
DATA = Path(
    os.environ.get("USDSPLAT_TEST_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data"
)


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of real captures, stages and oracles; tests that need it skip visibly without it."""
    if not (DATA / "README.md").is_file():
        pytest.skip(f"no test data at {DATA}; set USDSPLAT_TEST_DATA")
    return DATA


VALIDATE = "USDSPLAT_VALIDATE"
"""Environment variable: "all" validates every stage that any test writes, "none" no stage."""
_EVERY = 8
"""One in so many tests has its stages validated; of slow tests, each."""
_LARGEST = 4_000_000
"""Maximum size of a validated file [byte]; without "all"."""


@pytest.fixture(autouse=True)
def stock_validation(request: pytest.FixtureRequest) -> Iterator[None]:
    """USD's validators find nothing in stages that we wrote to the test's folder.

    A test whose stages are wrong on purpose has the marker `wrong_stages`.
    """
    yield
    asked = os.environ.get(VALIDATE, "")
    is_sampled = zlib.crc32(request.node.nodeid.encode()) % _EVERY == 0
    is_wanted = asked == "all" or request.node.get_closest_marker("slow") or is_sampled
    if asked == "none" or not is_wanted or request.node.get_closest_marker("wrong_stages"):
        return
    folder = request.node.funcargs.get("tmp_path")
    stages = [] if folder is None else sorted(Path(folder).rglob("*.usd*"))
    stages = [path for path in stages if path.name.isprintable()]  # USD's validators raise else
    if asked != "all":
        stages = [path for path in stages if path.is_file() and path.stat().st_size <= _LARGEST]
    if stages:
        from tests.stock_validation import errors, is_ours

        found = {path.name: errors(path) for path in stages if is_ours(path)}
        assert not any(found.values()), found


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
