"""Tests of the shapes of new matter. Oracles: geometry on a sphere of carriers."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.sphere import SPACING, front_from_above, sphere
from usdsplat.kernels.devices import open_device
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.corals import Corals
from usdsplat.sim.motifs import Cells, Plates, sites_of
from usdsplat.sim.needles import Needles
from usdsplat.sim.vein_tree import Veins

SIZE = 8.0
NEVER, LATE = np.inf, 100.0


@pytest.fixture(scope="module")
def device(any_device):
    """One thread: there are many small launches."""
    return open_device(threads=1)


@pytest.fixture(scope="module")
def carriers(device) -> Carriers:
    """Carriers on the unit sphere."""
    return sphere(device)


@pytest.fixture(scope="module")
def arrival(carriers) -> np.ndarray:
    """A front from the highest point, which takes two seconds to the lowest."""
    return front_from_above(carriers)


def test_sites_are_evenly_spaced(device, carriers) -> None:
    """Oracle: distances: no two sites closer than half the size; no carrier farther than it."""
    sites = carriers.positions[sites_of(device, carriers, SIZE, 3)]
    apart = np.linalg.norm(sites[:, None] - sites[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > 0.5 * SIZE * SPACING
    far = np.linalg.norm(carriers.positions[:, None] - sites[None], axis=2).min(axis=1)
    assert far.max() < SIZE * SPACING


@pytest.mark.parametrize("motif", [Cells, Plates, Needles, Veins, Corals])
def test_matter_begins_behind_the_front_and_never_goes_back(
    motif, device, carriers, arrival
) -> None:
    """Oracle: the front: nothing at first, nothing ahead of it by more than a piece, and
    where matter is it stays."""
    made = motif(device, carriers, SIZE, 1)
    assert not made.at(np.full(len(carriers), NEVER, np.float32), LATE).rise.any()
    before = np.zeros(len(carriers), np.float32)
    for now in (0.5, 1.0, 1.5, 3.0, LATE):
        rise = made.at(arrival, now).rise
        assert ((rise > 0) >= (before > 0)).all() and (rise <= 1).all()
        ahead = (arrival - now) * np.pi / 2
        assert not rise[ahead > 1.5 * SIZE * SPACING].any()
        before = rise
    assert (before > 0).mean() > 0.15


def test_cells_cover_everything_and_are_lowest_at_their_seams(device, carriers, arrival) -> None:
    """Oracle: distances to the two nearest sites: equal on a seam."""
    look = Cells(device, carriers, SIZE, 1).at(arrival, LATE)
    sites = carriers.positions[sites_of(device, carriers, SIZE, 1)]
    far = np.sort(np.linalg.norm(carriers.positions[:, None] - sites[None], axis=2), axis=1)
    on_seam, at_site = far[:, 1] < 1.1 * far[:, 0], far[:, 0] < 0.25 * far[:, 1]
    assert (look.rise > 0).mean() > 0.98
    assert look.rise[at_site].min() > 0.9 and look.rise[on_seam].max() < 0.3
    assert look.tone[at_site].min() > look.tone[on_seam].max()


def test_veins_are_a_tree_that_is_thickest_at_its_root(device, carriers, arrival) -> None:
    """Oracle: Murray's law in words: the thickest part is near the root, thin parts are most of
    it."""
    rise = Veins(device, carriers, SIZE, 1).at(arrival, LATE).rise
    thick = rise > 0.8 * rise.max()
    assert carriers.positions[thick, 1].min() > 0
    assert 0.05 < (rise > 0).mean() < 0.7
    assert np.median(rise[rise > 0]) < 0.6 * rise.max()


def test_needles_have_many_lengths_and_directions(device, carriers) -> None:
    """Oracle: unit vectors that lean out of the ball by less than a right angle, of a fourfold
    range of lengths, with bare ground between; each carrier has its own rank."""
    prisms = Needles(device, carriers, 4.0, 1).prisms
    np.testing.assert_allclose(np.linalg.norm(prisms.axes, axis=1), 1, atol=1e-5)
    outward = (prisms.axes * prisms.bases).sum(axis=1) / np.linalg.norm(prisms.bases, axis=1)
    assert (outward > 0).mean() > 0.99 and np.quantile(outward, 0.1) < 0.9
    long = prisms.lengths > 0
    assert prisms.lengths.max() > 4 * prisms.lengths[long].min() and 0.3 < long.mean() < 0.95
    assert len(np.unique(np.stack([prisms.site, prisms.rank]), axis=1).T) == len(carriers)
