"""Tests of drivers. Oracle: their definitions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.devices import all_cores
from tests.sim.test_population import capture, normals
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.drivers import changes, drive
from usdsplat.sim.parameters import DriverParameters
from usdsplat.sim.state import State

DEVICE = open_device()
N = 3000
CROWDING = np.random.default_rng(8).uniform(0, 2, N).astype(np.float32)
C0 = 0.5 / np.sqrt(np.pi)


def moved() -> State:
    """Splats with a past."""
    rng = np.random.default_rng(7)
    state = capture(N)
    state.uv[:, 0] = rng.uniform(0, 1, N)
    state.births[:] = rng.uniform(0, 3, N)
    state.velocities[:] = rng.normal(size=(N, 3))
    state.positions += rng.normal(size=(N, 3)).astype(np.float32)
    return state


def own(state) -> SplatCloud:
    """What is drawn, in arrays of its own."""
    cloud = state.cloud()
    return replace(
        cloud,
        positions=cloud.positions.copy(),
        scales=cloud.scales.copy(),
        opacities=cloud.opacities.copy(),
        sh=cloud.sh.copy(),
    )


def driven(state, *, device=DEVICE, now=4.0, **options) -> tuple[SplatCloud, SplatCloud]:
    """What is drawn without and with a driver; the driver changes what it says, no more."""
    driver = DriverParameters(**options)
    before, after = own(state), own(state)
    digest = state.digest()
    for name in {"positions", "scales", "opacities", "sh"} - {changes(driver)}:
        getattr(after, name).flags.writeable = False
    after = drive(device, state, after, driver, crowding=CROWDING, normals=normals(N), now=now)
    assert state.digest() == digest
    for name in ("positions", "rotations", "scales", "opacities", "sh"):
        same = np.array_equal(getattr(before, name), getattr(after, name))
        assert same == (name != changes(driver)), name
    return before, after


def part(value, low, high, ease) -> np.ndarray:
    """Oracle of the ease, in float64."""
    t = np.clip((value.astype(float) - low) / (high - low), 0, 1)
    curves = {"linear": t, "smooth": 3 * t**2 - 2 * t**3, "smoother": 6 * t**5 - 15 * t**4}
    return curves[ease] + (10 * t**3 if ease == "smoother" else 0)


@pytest.mark.parametrize("ease", ["linear", "smooth", "smoother"])
@pytest.mark.parametrize(
    ("source", "low", "high"),
    [("u", 0.1, 0.9), ("v", 0.3, 0.1), ("vMinusU", -0.5, 0.2), ("crowding", 0.8, 1.5),
     ("age", 1.2, 3.0), ("speed", 0.5, 2.0), ("distance", 2.0, 0.5)],
)  # fmt: skip
def test_sources_and_eases(source, low, high, ease) -> None:
    """Oracle: each source and each ease in float64, seen through a displacement."""
    state = moved()
    value = {
        "u": state.uv[:, 0],
        "v": state.uv[:, 1],
        "vMinusU": state.uv[:, 1] - state.uv[:, 0],
        "crowding": CROWDING,
        "age": 4.0 - state.births,
        "speed": np.linalg.norm(state.velocities, axis=1),
        "distance": np.linalg.norm(state.positions - state.rest_positions, axis=1),
    }[source]
    before, after = driven(
        state, source=source, in_min=low, in_max=high, ease=ease, output="displacement", amount=-0.5
    )
    way = -0.5 * part(value, low, high, ease)[:, None] * normals(N)
    assert np.abs(way).max() > 0.4
    assert np.abs(after.positions - before.positions - way).max() < 2e-6


def test_a_range_without_width_is_a_step() -> None:
    """Oracle: the comparison."""
    state = moved()
    before, after = driven(state, in_min=0.2, in_max=0.2, output="opacity", amount=0.5)
    factor = np.where(state.uv[:, 1] >= np.float32(0.2), np.float32(0.5), np.float32(1))
    assert np.array_equal(after.opacities, before.opacities * factor)


def test_factors() -> None:
    """Oracle: 1 + a (amount - 1), never below 0, in float64; opacity never above 1; thickness is
    the smallest axis, the last of equal ones."""
    state = moved()
    state.scales[:5] = [(1, 1, 1), (1, 2, 1), (1, 1, 2), (2, 1, 1), (0.5, 1, 2)]
    a = part(state.uv[:, 1], 0, 0.4, "smooth")
    options = {"in_max": 0.4}
    for amount in (2.5, 0.1, 0.0, -3.0):
        factor = np.maximum(0, 1 + a * (amount - 1))
        before, after = driven(state, output="scale", amount=amount, **options)
        assert np.abs(after.scales - before.scales * factor[:, None]).max() < 2e-6
        before, after = driven(state, output="opacity", amount=amount, **options)
        assert np.abs(after.opacities - np.minimum(1, before.opacities * factor)).max() < 1e-6
        before, after = driven(state, output="thickness", amount=amount, **options)
        axis = 2 - np.argmin(before.scales[:, ::-1], axis=1)
        expected = before.scales.astype(float)
        expected[np.arange(N), axis] *= factor
        assert np.abs(after.scales - expected).max() < 2e-6


def test_colour_is_mixed_in_and_view_dependence_fades() -> None:
    """Oracle: colours 0.5 + C0 dc in float64; other bands by 1 - m sh_fade."""
    state = moved()
    color = np.array([0.9, 0.05, 0.3])
    for amount, fade in ((1.0, 1.0), (0.6, 0.25), (7.0, 0.0)):
        before, after = driven(
            state, in_max=0.4, output="color", amount=amount, color=tuple(color), sh_fade=fade
        )
        m = np.minimum(1, amount * part(state.uv[:, 1], 0, 0.4, "smooth"))[:, None]
        seen = 0.5 + C0 * after.sh[:, 0].astype(float)
        expected = (1 - m) * (0.5 + C0 * before.sh[:, 0].astype(float)) + m * color
        assert np.abs(seen - expected).max() < 1e-6
        bands = before.sh[:, 1:] * (1 - m * fade)[:, None]
        assert np.abs(after.sh[:, 1:] - bands).max() < 1e-6


def test_drivers_do_not_accumulate_and_threads_do_not_matter() -> None:
    """Oracle: the same frame made again, by one thread, bit by bit."""
    state = moved()
    for output in ("scale", "color"):
        frames = [
            driven(state, device=device, output=output, amount=0.5, source="speed")[1]
            for device in (all_cores(), all_cores(), CpuDevice(threads=1))
        ]
        for name in ("scales", "sh"):
            first, *others = (getattr(frame, name) for frame in frames)
            assert all(np.array_equal(first, other) for other in others)
