"""Tests of patterns on particles."""

from __future__ import annotations

from typing import get_args, get_type_hints

import numpy as np
import pytest
from numpy.polynomial import legendre

from tests.devices import all_cores
from tests.folded import folded_rows
from tests.sim.patterns import area, laplacian, wavelength
from tests.sim.spheres import graph_of, relaxed_sphere
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.parameters import RdParameters
from usdsplat.sim.presets_rd import PRESETS
from usdsplat.sim.reaction import Reaction
from usdsplat.sim.seeds import nuclei, plant, untouched

DEGREE = 12


@pytest.fixture(scope="module")
def device(any_device):
    """All threads."""
    return open_device()


@pytest.fixture(scope="module")
def sphere(any_device, device):
    """20,000 points after 20 sweeps."""
    return relaxed_sphere(device, 20_000)


@pytest.fixture(scope="module")
def few(any_device, device):
    """A graph of fewer points."""
    return graph_of(device, relaxed_sphere(device, 2000))


def seeded(device, points, reaction):
    """u and v where a pattern begins."""
    uv = untouched(len(points))
    plant(device, uv, nuclei(device, points, reaction.parameters, reaction.scale))
    return uv


@pytest.mark.parametrize(("target", "tolerance"), [(16, 0.15), (32, 0.09)])
def test_the_laplacian_of_a_spherical_harmonic(device, sphere, target, tolerance) -> None:
    """Oracle: L P12 = -12 * 13 P12 on the unit sphere; relative L2 error."""
    reaction = Reaction(device, graph_of(device, sphere, target), RdParameters())
    z = sphere[:, 2].astype(np.float64)[reaction.graph.order]
    values = legendre.legval(z, [0] * DEGREE + [1])
    wanted = -DEGREE * (DEGREE + 1) * values
    error = laplacian(reaction, values) - wanted
    assert np.linalg.norm(error) / np.linalg.norm(wanted) <= tolerance


@pytest.mark.parametrize(
    ("preset", "part"),
    folded_rows(
        [
            ("labyrinth", 0.46), ("spots", 0.22), ("worms", 0.42), ("coral", 0.53), ("holes", 0.75),
            ("chaos", None), ("uskate", None),
        ],
        keep=2,
    ),
)  # fmt: skip
def test_presets_make_their_patterns(device, sphere, preset, part) -> None:
    """Oracle: areas that an independent prototype measured after 6,000 steps; of the two patterns
    that never come to rest, that they are there, and are neither even nor everywhere."""
    reaction = Reaction(device, graph_of(device, sphere), RdParameters(preset=preset))
    assert reaction.subdivisions == 1
    v = reaction.step(seeded(device, sphere, reaction), 6000)[:, 1]
    if part is None:
        assert 0.1 < area(v) < 0.9 and v.std() > 0.03
    else:
        assert area(v) == pytest.approx(part, abs=0.05)
    assert 8 < wavelength(reaction, v[reaction.graph.order]) < 25


def test_diffusion_conserves(device, few) -> None:
    """Oracle: without reaction the sums of u and v stay; drift of 1e-6 a point in 1,000 steps."""
    rd = RdParameters(feed=0.0, kill=0.0, conservative=True)
    reaction = Reaction(device, few, rd)
    uv = np.zeros((2000, 2), np.float32)  # v = 0: u v^2 = 0
    uv[:, 0] = np.random.default_rng(6).uniform(0, 1, 2000)
    after = reaction.step(uv, 1000)
    assert after[:, 0].std() < 0.5 * uv[:, 0].std()
    drift = abs(after[:, 0].sum(dtype=np.float64) - uv[:, 0].sum(dtype=np.float64))
    assert drift <= 1e-6 * 2000


@pytest.mark.parametrize("conservative", [False, True])
@pytest.mark.parametrize("anisotropy", [0.0, 0.7])
def test_diffusion_makes_no_new_extremes(device, few, conservative, anisotropy) -> None:
    """Oracle: the discrete maximum principle, but for rounding; also at the longest step."""
    rd = RdParameters(
        feed=0.0, kill=0.0, d_tau=2.0, conservative=conservative, anisotropy=anisotropy
    )
    reaction = Reaction(device, few, rd)
    uv = np.zeros((2000, 2), np.float32)
    uv[::7, 0] = 1
    for _ in range(20):
        after = reaction.step(uv, 1)
        assert after[:, 0].min() >= uv[:, 0].min() - 1e-7
        assert after[:, 0].max() <= uv[:, 0].max() + 1e-7
        uv = after


def test_steps_are_divided_until_they_are_stable(device, few) -> None:
    """Oracle: a pattern stays between 0 and 1, and is about the same with twice the steps of half
    the length, at a lattice unit for which one step would not be stable."""
    rd = RdParameters(pattern_scale=3 * Reaction(device, few, RdParameters()).spacing)
    reaction = Reaction(device, few, rd)
    assert reaction.subdivisions > 3
    uv = untouched(2000)
    plant(device, uv, (few.positions[few.rank, 2] > 0.8).astype(np.float32))
    found = reaction.step(uv, 100)
    assert found.min() >= 0 and found.max() <= 1
    reaction.adopt(RdParameters(pattern_scale=rd.pattern_scale, d_tau=0.5))
    np.testing.assert_allclose(reaction.step(uv, 200), found, atol=0.02)


def test_a_lattice_unit_below_the_spacing_is_noticed(device, few) -> None:
    """Oracle: the spacing of points on a sphere, the root of the area of each."""
    reaction = Reaction(device, few, RdParameters())
    assert reaction.spacing == pytest.approx(np.sqrt(4 * np.pi / 2000), rel=0.03)
    for factor, wanted in ((0.7, True), (0.9, False)):
        reaction.adopt(RdParameters(pattern_scale=factor * reaction.spacing))
        assert reaction.is_too_fine is wanted


def test_rates_are_offset_point_by_point(device, few) -> None:
    """Oracle: without diffusion and v, u goes to 1 as 1 - (1 - F)^n; nothing where F is 0."""
    rd = RdParameters(feed=0.05, diffusion_u=0.0, diffusion_v=0.0)
    offset = np.where(np.arange(2000) < 500, -0.2, 0.02).astype(np.float32)
    after = Reaction(device, few, rd).step(np.zeros((2000, 2), np.float32), 10, feed_offset=offset)
    wanted = np.where(np.arange(2000) < 500, 0, 1 - (1 - 0.07) ** 10)
    np.testing.assert_allclose(after[:, 0], wanted, atol=1e-6)
    decayed = Reaction(device, few, rd).step(np.tile(np.array([0, 1], np.float32), (2000, 1)), 1)
    np.testing.assert_allclose(decayed[:, 1], 1 - 0.05 - 0.06, atol=1e-6)


def test_spots_are_stretched_along_a_direction(device) -> None:
    """Oracle: spots are round; with anisotropy v changes less along the direction than across."""
    points = relaxed_sphere(device, 6000)
    graph = graph_of(device, points)
    ratios = []
    for anisotropy in (0.0, 0.7):
        rd = RdParameters(preset="spots", anisotropy=anisotropy, direction=(0.0, 0.0, 1.0))
        reaction = Reaction(device, graph, rd, normals=points)
        v = reaction.step(seeded(device, points, reaction), 3000)[graph.order, 1]
        own = np.repeat(np.arange(6000), np.diff(graph.rows))
        offset = graph.positions[graph.neighbors] - graph.positions[own]
        belt = np.abs(graph.positions[own, 2]) < 0.4
        change = (v[graph.neighbors] - v[own]) ** 2
        length = np.linalg.norm(offset, axis=1)
        up = np.abs(offset[:, 2]) / length
        ratios.append(change[belt & (up > 0.9)].mean() / change[belt & (up < 0.3)].mean())
    assert ratios[0] == pytest.approx(1, abs=0.3)
    assert ratios[1] < 0.5 * ratios[0]


def test_threads_do_not_matter(few) -> None:
    """Oracle: one thread, bit for bit."""
    found = []
    for device in (CpuDevice(threads=1), all_cores()):
        reaction = Reaction(device, few, RdParameters(conservative=True, anisotropy=0.5))
        found.append(reaction.step(seeded(device, few.positions[few.rank], reaction), 50))
    assert found[0].tobytes() == found[1].tobytes()


def test_names_are_those_of_the_parameter() -> None:
    """Oracle: the tokens that the parameter allows."""
    tokens = get_args(get_type_hints(RdParameters)["preset"])
    assert set(PRESETS) == set(tokens) - {"custom"}
