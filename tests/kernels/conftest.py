"""Fixture that runs kernel tests on each device."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.devices import NAMES, device_of
from tests.render import rendering, surface_scenes
from usdsplat.kernels import store
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device


@pytest.fixture(params=NAMES)
def device(request: pytest.FixtureRequest) -> Device:
    """The CPU, then the GPU."""
    return device_of(request.param)


@pytest.fixture
def scenes_on_device(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """What helpers draw is drawn on `device`."""
    for module in (rendering, surface_scenes):
        monkeypatch.setattr(module, "open_device", lambda **_: device)


@pytest.fixture
def on_device(
    device: Device, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """What the module calls `open_device()` is `device`."""

    def opened(*, threads: int | None = None) -> Device:
        return device if threads is None else open_device(device.name, threads=threads)

    monkeypatch.setattr(request.module, "open_device", opened)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for compiled kernels, of this test alone."""
    monkeypatch.setattr(store, "_chosen", None)
    monkeypatch.setattr(store, "_refusal", "")
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "kernels"))
    return tmp_path / "kernels"
