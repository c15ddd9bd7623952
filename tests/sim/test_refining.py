"""Tests of dividing splats into children."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.devices import all_cores
from tests.sim.test_transport import axes_of
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim import carriers
from usdsplat.sim.refining import GROWTH, SEEN, Cuts, Shapes, oversized, refined, split
from usdsplat.sim.split_table import OPACITIES, SIGMAS, TABLE

DEVICE = open_device()
EVERY = [
    (n, size) for n, ends in SIGMAS.items() for size in (ends[0], 0.5 * sum(ends), 0.999 * ends[1])
]


def one(*, scales=(1.0, 0.5, 0.0), opacity=0.5, n=1, turn=(1.0, 0.0, 0.0, 0.0)) -> SplatCloud:
    """Equal splats at the origin."""
    turn = np.asarray(turn, np.float64)
    return SplatCloud(
        positions=np.zeros((n, 3), np.float32),
        scales=np.tile(np.float32(scales), (n, 1)),
        rotations=np.tile(np.float32(turn / np.linalg.norm(turn)), (n, 1)),
        opacities=np.full(n, opacity, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def cloud(n=400, seed=0, *, degree=1) -> SplatCloud:
    """Splats of which nothing is alike, with ids that have gaps, and velocities."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(n, 4))
    return SplatCloud(
        positions=rng.uniform(-1, 1, (n, 3)).astype(np.float32),
        scales=(0.02 * np.exp(rng.normal(0, 1, (n, 3)))).astype(np.float32),
        rotations=(turns / np.linalg.norm(turns, axis=1)[:, None]).astype(np.float32),
        opacities=rng.uniform(0, 1, n).astype(np.float32),
        sh=rng.normal(size=(n, (degree + 1) ** 2, 3)).astype(np.float32),
        ids=np.cumsum(rng.integers(1, 5, n)),
        velocities=rng.normal(size=(n, 3)).astype(np.float32),
    )


def divided(whole: SplatCloud, limit: float) -> Shapes:
    """The children of one pass."""
    shapes = Shapes.of(whole)
    return split(DEVICE, shapes, Cuts.of(DEVICE, shapes, limit=limit))[0]


def seen(parts: Shapes, axes: tuple[int, int], far: float = 3.4) -> tuple[np.ndarray, np.ndarray]:
    """Opacity of unrotated splats seen along the third axis, and the squared distance from the
    origin in standard deviations of a splat with half axes 1 and 0.5: in float64, on a grid.
    """
    x, y = np.meshgrid(np.linspace(-far, far, 101), np.linspace(-far / 2, far / 2, 51))
    clear = np.ones_like(x)
    for at, size, opacity in zip(
        parts.positions.astype(float), parts.scales.astype(float), parts.opacities, strict=True
    ):
        square = sum(
            ((grid - at[axis]) / size[axis]) ** 2 for grid, axis in zip((x, y), axes, strict=True)
        )
        clear *= 1 - float(opacity) * np.exp(-square / 2)
    return 1 - clear, x**2 + (2 * y) ** 2


def noise(parts: Shapes, opacity: float, axes: tuple[int, int] = (0, 1)) -> float:
    """dB against the splat in the ellipse in which it is drawn."""
    found, square = seen(parts, axes)
    error = found - opacity * np.exp(-square / 2)
    return float(-10 * np.log10(np.mean(error[square <= 3.4**2] ** 2)))


@pytest.mark.parametrize(("n", "size"), EVERY)
@pytest.mark.parametrize(("opacity", "least"), [(0.1, 67), (0.37, 48), (0.5, 48), (0.95, 40)])
def test_children_together_look_like_the_splat(n, size, opacity, least) -> None:
    """Oracle: the splat's own Gaussian, along and across; the figures of the recipe, at opacities
    and sizes of the table and between; two children lose 4 dB more of an opaque splat.
    """
    parts = divided(one(opacity=opacity), size)
    assert len(parts) == n
    assert noise(parts, opacity) > (least if n > 2 else least - 4)


@pytest.mark.parametrize(("n", "size"), EVERY)
@pytest.mark.parametrize("opacity", [0.1, 0.95])
def test_children_keep_mass_centre_and_second_moments(n, size, opacity) -> None:
    """Oracle: those of a Gaussian, pi A and 1 in its own units; within 3.5 %, two children 5 %."""
    found, _ = seen(divided(one(opacity=opacity), size), (0, 1), far=6)
    x, y = np.meshgrid(np.linspace(-6, 6, 101), np.linspace(-6, 6, 51))
    cell = (12 / 100) * (12 / 50)
    mass = found.sum() * cell
    moments = np.array([(found * x).sum(), (found * x * x).sum(), (found * y * y).sum()])
    moments = moments / found.sum()
    most = 0.05 if n == 2 else 0.035
    assert mass == pytest.approx(2 * math.pi * opacity, rel=most)
    np.testing.assert_allclose(moments, [0, 1, 1], atol=most)


def test_children_are_those_of_the_table_along_the_longest_axis() -> None:
    """Oracle: the table's own numbers, on an axis turned in float64."""
    turn = np.float64([0.3, -0.5, 0.7, 0.2])
    whole = one(scales=(0.2, 0.9, 1e-6), opacity=OPACITIES[3], turn=turn)
    for entry, (n, (least, _)) in enumerate(SIGMAS.items()):
        parts = divided(whole, 0.9 * least * (1 + 1e-6))
        first = TABLE.firsts[entry]
        offsets, across, opacities = TABLE.children[0, 3, first : first + n].T
        axis = axes_of(whole.rotations)[0][:, 1]
        np.testing.assert_allclose(
            parts.positions, 0.9 * offsets[:, None] * axis, rtol=1e-4, atol=1e-6
        )
        np.testing.assert_allclose(parts.scales[:, 1], 0.9 * least, rtol=1e-5)
        np.testing.assert_allclose(parts.scales[:, 0], 0.2 * across, rtol=1e-4)
        np.testing.assert_allclose(parts.opacities, OPACITIES[3] * opacities, rtol=1e-4)
        np.testing.assert_array_equal(parts.rotations, np.tile(whole.rotations, (n, 1)))


def test_children_of_a_thick_splat_keep_its_mean_opacity_over_all_directions() -> None:
    """Oracle: for faint splats, opacity times the area of the shadow, averaged over directions in
    float64; a splat that is flat is the table's, seen from the front.
    """
    directions = np.random.default_rng(1).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]

    def mean(scales: np.ndarray) -> float:
        a, b, c = scales.astype(float)
        shadow = np.sqrt(((directions * [b * c, a * c, a * b]) ** 2).sum(axis=1))
        return float(shadow.mean())

    for scales in ((1.0, 0.9, 0.8), (1.0, 0.5, 0.4), (1.0, 0.3, 0.02), (1.0, 1.0, 0.0)):
        whole = one(scales=scales, opacity=0.02)
        shapes = Shapes.of(whole)
        parts, _ = split(DEVICE, shapes, Cuts.of(DEVICE, shapes, limit=0.5, faint=0.0))
        total = sum(a * mean(s) for a, s in zip(parts.opacities, parts.scales, strict=True))
        assert total == pytest.approx(0.02 * mean(whole.scales[0]), rel=0.03)


def test_both_long_axes_are_divided_and_look_like_the_splat() -> None:
    """Oracle: the splat's own Gaussian."""
    whole = one(scales=(1.0, 0.5, 0.0), opacity=0.9)
    parts, _ = refined(DEVICE, whole, limit=0.3, budget=1000)
    assert parts.scales.max() <= 0.3
    assert noise(Shapes.of(parts), 0.9) > 41
    assert len(np.unique(parts.positions[:, 0])) > 3 < len(np.unique(parts.positions[:, 1]))


def test_no_splat_that_counts_is_longer_than_the_limit() -> None:
    """Oracle: brute force over the result; splats that stay are unchanged, in their order."""
    whole = cloud()
    found, parents = refined(DEVICE, whole, limit=0.03, budget=10**6)
    size = found.scales.max(axis=1)
    counts = found.opacities >= np.where(np.isin(found.ids, whole.ids), 0.1, SEEN)
    assert (size[counts] <= np.float32(0.03)).all() and (size[~counts] > 0.03).any()
    stays = np.flatnonzero((whole.scales.max(axis=1) <= 0.03) | (whole.opacities < 0.1))
    np.testing.assert_array_equal(parents[: len(stays)], stays)
    for name in ("positions", "rotations", "scales", "opacities", "sh", "ids", "velocities"):
        kept = getattr(found, name)[: len(stays)]
        np.testing.assert_array_equal(kept, getattr(whole, name)[stays])
    assert (found.opacities[len(stays) :] >= SEEN).all()
    assert oversized(DEVICE, found, limit=0.03, faint=0.0) >= 0
    assert oversized(DEVICE, found, limit=0.03) == 0


def test_children_have_their_splats_colour_rotation_and_velocity_and_new_ids() -> None:
    """Oracle: rows of the capture; ids ascend, and new ones follow the largest."""
    whole = cloud(degree=3)
    found, parents = refined(DEVICE, whole, limit=0.02, budget=10**6)
    np.testing.assert_array_equal(found.sh, whole.sh[parents])
    np.testing.assert_array_equal(found.rotations, whole.rotations[parents])
    np.testing.assert_array_equal(found.velocities, whole.velocities[parents])
    is_new = ~np.isin(found.ids, whole.ids)
    new = found.ids[is_new]
    np.testing.assert_array_equal(new, whole.ids.max() + 1 + np.arange(len(new)))
    assert (np.diff(found.ids) > 0).all() and (np.diff(parents[is_new]) >= 0).all()


def test_rows_are_ids_of_a_cloud_without_ids() -> None:
    """Oracle: row numbers."""
    whole = edit.merge([one(scales=(1, 0.1, 0)), one(scales=(0.1, 0.1, 0))])
    found, parents = refined(DEVICE, whole, limit=0.5)
    assert found.ids[0] == 1 and parents[0] == 1
    np.testing.assert_array_equal(found.ids[1:], 2 + np.arange(len(found) - 1))
    assert (parents[1:] == 0).all()


def test_a_cloud_without_large_splats_is_returned_itself() -> None:
    """Oracle: identity."""
    whole = cloud()
    for limit in (1.0, 1e30, math.inf):
        found, parents = refined(DEVICE, whole, limit=limit)
        assert found is whole
        np.testing.assert_array_equal(parents, np.arange(len(whole)))


def test_needles_are_divided_by_their_anisotropy_unless_they_are_short() -> None:
    """Oracle: the ratio of the two longest axes, and a quarter of the limit."""
    long, short = one(scales=(0.5, 0.01, 0.01)), one(scales=(0.2, 0.01, 0.01))
    assert refined(DEVICE, long, limit=1.0)[0] is long
    found, _ = refined(DEVICE, long, limit=1.0, anisotropy=10, budget=100)
    assert len(found) > 1 and found.scales[:, 0].max() <= 0.25
    assert refined(DEVICE, short, limit=1.0, anisotropy=10)[0] is short


def test_a_budget_goes_to_the_largest_splats() -> None:
    """Oracle: sizes; the number is never above the budget, and the default is GROWTH times."""
    whole = edit.take(cloud(), np.flatnonzero(cloud().opacities >= 0.1))
    whole = edit.take(whole, np.argsort(-whole.scales.max(axis=1), kind="stable"))
    sizes = whole.scales.max(axis=1)
    for budget in (len(whole) + 1, len(whole) + 60, 2 * len(whole)):
        found, parents = refined(DEVICE, whole, limit=0.9 * float(sizes.min()), budget=budget)
        assert len(found) <= budget
        cut = np.setdiff1d(np.arange(len(whole)), parents[np.isin(found.ids, whole.ids)])
        np.testing.assert_array_equal(cut, np.arange(len(cut)))
    found, _ = refined(DEVICE, whole, limit=1e-4)
    assert 0.9 * GROWTH * len(whole) < len(found) <= GROWTH * len(whole)
    for budget in (0, len(whole) - 1, len(whole)):
        assert refined(DEVICE, whole, limit=0.01, budget=budget)[0] is whole


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    """Oracle: bits of one thread."""
    whole = cloud(20_000)
    one_thread, all_threads = (
        refined(device, whole, limit=0.02, budget=60_000)[0]
        for device in (CpuDevice(threads=1), all_cores())
    )
    for name in ("positions", "scales", "opacities", "rotations", "ids"):
        np.testing.assert_array_equal(getattr(one_thread, name), getattr(all_threads, name))


def test_degenerate_splats_stay_and_do_no_harm() -> None:
    """Oracle: splats that are not finite, empty or of one opacity are as given."""
    whole = one(scales=(1.0, 0.5, 0.0), n=9)
    positions, scales, opacities = (
        whole.positions.copy(), whole.scales.copy(), whole.opacities.copy(),
    )  # fmt: skip
    positions[0, 1], positions[1, 0] = np.nan, np.inf
    scales[2, 2], scales[3, 0] = np.nan, np.inf
    scales[4], opacities[5], opacities[6], opacities[7] = 0, 0, 1, np.nan
    odd = SplatCloud(
        positions=positions, scales=scales, rotations=whole.rotations, opacities=opacities,
        sh=whole.sh,
    )  # fmt: skip
    found, parents = refined(DEVICE, odd, limit=0.3, budget=1000)
    is_new = found.ids >= len(odd)
    np.testing.assert_array_equal(np.unique(parents[is_new]), [6, 8])
    np.testing.assert_array_equal(found.ids[~is_new], [0, 1, 2, 3, 4, 5, 7])
    assert np.isfinite(found.positions[is_new]).all() and np.isfinite(found.scales[is_new]).all()
    assert 0.6 < found.opacities[is_new].max() <= 1
    kept, _ = refined(DEVICE, odd, limit=0.0, budget=40)
    assert 9 < len(kept) <= 40


@pytest.mark.parametrize("limit", [0.0, 1e-30, 0.01])
def test_three_huge_flat_splats_end_at_the_budget(limit) -> None:
    """Oracle: the budget, by default and given."""
    whole = edit.merge(list(itertools.repeat(one(scales=(1e3, 1e3, 0.0), opacity=1.0), 3)))
    found, _ = refined(DEVICE, whole, limit=limit)
    assert len(found) <= 3 * GROWTH
    found, _ = refined(DEVICE, whole, limit=limit, budget=5000)
    assert 3000 < len(found) <= 5000 and np.isfinite(found.positions).all()


def test_the_expected_spacing_is_that_of_the_carriers() -> None:
    """Oracle: the carriers themselves, with and without a limit of their number; 20 %."""
    from tests.sim.recipes import ball

    whole = ball(3000)
    for most in (carriers.MOST, 1000):
        found = carriers.expected_spacing(DEVICE, whole, most=most)
        assert found == pytest.approx(
            carriers.Carriers.of(DEVICE, whole, most=most).spacing, rel=0.2
        )
    lone = one()
    assert carriers.expected_spacing(DEVICE, lone) == 0
    assert carriers.expected_spacing(DEVICE, edit.merge([lone, lone])) == 0
