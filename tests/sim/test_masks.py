"""Tests of masks: each source, remapping and combination."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sim.affectors import affector, placed, rotation
from tests.sim.recipes import mask
from usdsplat.core.cloud import F32
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.level_sets import filled
from usdsplat.sim.masks import Masks, Sites
from usdsplat.sim.specs import LevelSet, Mask, Picture, Surface


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-1, 1, (4000, 3)).astype(np.float32)


def sites(points: F32 = POINTS, **given: Any) -> Sites:
    """Points that are at rest."""
    n = len(points)
    plain = {
        "rest": points, "current": points, "uv": np.zeros((n, 2), np.float32),
        "ages": np.zeros(n, np.float32), "rows": None, "seconds": 0.0,
    }  # fmt: skip
    return Sites(**{**plain, **given})


def values(device, *masks: Mask, **given: Any) -> F32:
    """The last of some masks."""
    known = {each.name: each for each in masks}
    return Masks(device, is_fixed=True).values(known, masks[-1].name, sites(**given))


# --- sources --------------------------------------------------------------------------------


def test_a_primvar_is_read_by_rows_of_the_capture(device) -> None:
    """Oracle: NumPy's indexing."""
    own = mask("primvar", primvar=np.linspace(0, 1, 50, dtype=np.float32))
    rows = RNG.integers(0, 50, len(POINTS)).astype(np.int32)
    assert np.array_equal(values(device, own, rows=rows), own.primvar[rows])


@pytest.mark.parametrize(("source", "column"), [("u", 0), ("v", 1)])
def test_the_pattern_is_a_mask(device, source: str, column: int) -> None:
    """Oracle: the state's numbers."""
    uv = RNG.uniform(0, 1, (len(POINTS), 2)).astype(np.float32)
    assert np.array_equal(values(device, mask(source), uv=uv), uv[:, column])


def test_age_is_remapped_from_seconds(device) -> None:
    """Oracle: a line from 2 s to 4 s."""
    ages = RNG.uniform(0, 6, len(POINTS)).astype(np.float32)
    found = values(device, mask("age", in_min=2.0, in_max=4.0), ages=ages)
    assert np.allclose(found, np.clip((ages - 2) / 2, 0, 1), atol=1e-6)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_an_axis_is_a_coordinate_of_the_frame(device, axis: str) -> None:
    """Oracle: the inverse of the frame, in float64."""
    frame = placed((0.2, -0.3, 0.5), rotation((1, 2, 3), 0.8))
    frame[:3, :3] *= 2
    found = values(device, mask("axis", axis=axis, frame=frame, clamp=False))
    exact = (POINTS - frame[:3, 3]) @ np.linalg.inv(frame[:3, :3]).T
    assert np.allclose(found, exact[:, "XYZ".index(axis)], atol=1e-6)


def test_noise_is_even_from_0_to_1_and_changes_smoothly(device) -> None:
    """Oracle: the uniform distribution; another seed and a later time are other noise."""
    points = RNG.uniform(-50, 50, (40_000, 3)).astype(np.float32)
    first = values(device, mask("noise", size=1.0), points=points)
    histogram = np.histogram(first, 10, (0, 1))[0] / len(points)
    assert np.abs(histogram - 0.1).max() < 0.025
    other = values(device, mask("noise", size=1.0, seed=1), points=points)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.05
    moving = mask("noise", size=1.0, speed=0.5)
    assert np.array_equal(values(device, moving, points=points), first)
    soon = values(device, moving, points=points, seconds=0.1)
    late = values(device, moving, points=points, seconds=2.0)
    assert 0 < np.abs(soon - first).mean() < 0.05
    assert abs(np.corrcoef(first, late)[0, 1]) < 0.05


def test_regions_of_affectors_are_joined_by_the_largest(device) -> None:
    """Oracle: two balls: 1 inside, a smooth step over the falloff outside."""
    balls = [
        affector("sphere", (0.4, 0, 0), placed((x, 0, 0)), falloff=0.5, path=f"/{x}", role="region")
        for x in (-0.5, 0.5)
    ]
    found = values(device, mask("affector", regions=tuple(balls)))
    exact = np.zeros(len(POINTS))
    for x in (-0.5, 0.5):
        t = np.clip((np.linalg.norm(POINTS - (x, 0, 0), axis=1) - 0.4) / 0.5, 0, 1)
        exact = np.maximum(exact, 1 - t * t * (3 - 2 * t))
    assert np.allclose(found, exact, atol=2e-6)


def test_curves_are_regions_around_their_segments(device) -> None:
    """Oracle: the distance to two segments, in float64."""
    ends = np.array([(-1, 0, 0), (0.5, 0.2, 0), (0.5, 0.2, 0.9)], np.float32)
    lines = Surface(points=ends, triangles=np.array([(0, 1, 1), (1, 2, 2)], np.int32))
    found = values(device, mask("curves", curves=lines, radius=0.1, falloff=0.4))
    distance = np.full(len(POINTS), np.inf)
    for a, b in ((0, 1), (1, 2)):
        along = ends[b].astype(float) - ends[a]
        t = np.clip((POINTS - ends[a]) @ along / (along @ along), 0, 1)
        distance = np.minimum(
            distance, np.linalg.norm(POINTS - ends[a] - t[:, None] * along, axis=1)
        )
    t = np.clip((distance - 0.1) / 0.4, 0, 1)
    assert np.allclose(found, 1 - t * t * (3 - 2 * t), atol=2e-5)


def shell(size: float = 0.05, band: float = 3.0) -> LevelSet:
    """The distance from a ball of radius 0.5, known in a narrow band, as a file has it."""
    n = 31
    at = (np.arange(n) - n // 2) * size
    z, y, x = np.meshgrid(at, at, at, indexing="ij")
    exact = (np.sqrt(x * x + y * y + z * z) - 0.5) / size
    matrix = np.diag([1 / size, 1 / size, 1 / size, 1.0])
    matrix[:3, 3] = n // 2
    return LevelSet(
        voxels=np.clip(exact, -band, band).astype(np.float32), band=band, to_grid=matrix
    )


def test_a_level_set_is_a_region_also_beyond_its_band(device) -> None:
    """Oracle: the distance from a ball, up to a fifth of a voxel; in a frame twice as large."""
    whole = filled(device, shell())
    n = whole.voxels.shape[0]
    at = (np.arange(n) - n // 2) * 0.05
    z, y, x = np.meshgrid(at, at, at, indexing="ij")
    exact = np.sqrt(x * x + y * y + z * z) - 0.5
    assert np.abs(whole.voxels * 0.05 - exact).max() < 0.01
    own = mask("volume", level_set=shell(), frame=np.diag([2.0, 2.0, 2.0, 1.0]), falloff=0.5)
    found = values(device, own)
    t = np.clip((np.linalg.norm(POINTS, axis=1) - 1.0) / 0.5, 0, 1)
    assert np.abs(found - (1 - t * t * (3 - 2 * t))).max() < 0.03
    inner = mask("volume", level_set=shell(), radius=-0.2)
    distance = np.linalg.norm(POINTS, axis=1)
    sure = np.abs(distance - 0.3) > 0.02
    assert np.array_equal(values(device, inner)[sure], (distance < 0.3)[sure])


RAMP = np.tile(np.linspace(0, 1, 64, dtype=np.float32), (32, 1))


def test_a_planar_texture_covers_the_unit_square_of_its_frame(device) -> None:
    """Oracle: a ramp from 0 at the centre of its first pixel to 1 at that of its last."""
    frame = np.diag([2.0, 1.0, 1.0, 1.0])
    own = mask("texture", picture=Picture(pixels=RAMP), frame=frame)
    found = values(device, own)
    inside = np.abs(POINTS[:, 1]) <= 0.5
    exact = np.clip(((POINTS[:, 0] / 2 + 0.5) * 64 - 0.5) / 63, 0, 1)
    assert np.allclose(found[inside], exact[inside], atol=1e-5)
    assert not found[~inside].any()
    held = values(device, mask("texture", picture=Picture(pixels=RAMP), frame=frame, wrap="clamp"))
    assert np.allclose(held, exact, atol=1e-5)
    upright = mask("texture", picture=Picture(pixels=np.flipud(RAMP.T).copy()), wrap="clamp")
    exact = np.clip(((POINTS[:, 1] + 0.5) * 64 - 0.5) / 63, 0, 1)
    assert np.allclose(values(device, upright), exact, atol=1e-5)


def test_a_repeated_texture_repeats(device) -> None:
    """Oracle: the picture one period away."""
    pixels = RNG.uniform(0, 1, (16, 16)).astype(np.float32)
    own = mask("texture", picture=Picture(pixels=pixels), wrap="repeat")
    away = POINTS + np.float32([3, -2, 0])
    assert np.allclose(values(device, own), values(device, own, points=away), atol=1e-4)


def test_a_spherical_texture_has_longitude_and_latitude(device) -> None:
    """Oracle: the angles; the middle of the picture is along -z, its top up."""
    turns = np.tile(np.linspace(0, 1, 256, dtype=np.float32), (64, 1))
    own = mask("texture", picture=Picture(pixels=turns), projection="spherical", wrap="clamp")
    longitude = np.arctan2(POINTS[:, 0], -POINTS[:, 2]) / (2 * np.pi) + 0.5
    away = (longitude > 0.01) & (longitude < 0.99)
    assert np.allclose(values(device, own)[away], longitude[away], atol=5e-3)
    ups = np.tile(np.linspace(1, 0, 256, dtype=np.float32)[:, None], (1, 64))
    own = mask("texture", picture=Picture(pixels=ups), projection="spherical", wrap="clamp")
    latitude = np.arcsin(POINTS[:, 1] / np.linalg.norm(POINTS, axis=1)) / np.pi + 0.5
    assert np.allclose(values(device, own), latitude, atol=5e-3)


def test_a_texture_through_a_lens_misses_what_is_behind_it(device) -> None:
    """Oracle: a pinhole at the origin that looks along -z, 90 degrees wide."""
    clip = np.array([(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, -1, 0), (0, 0, -1, 0)], float)
    picture = Picture(pixels=RAMP, to_clip=clip)
    found = values(device, mask("texture", picture=picture, projection="camera"))
    ahead = POINTS[:, 2] < -1e-3
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (POINTS[:, a] / -POINTS[:, 2] for a in (0, 1))
    seen = ahead & (np.abs(x) <= 1) & (np.abs(y) <= 1)
    exact = np.clip(((x / 2 + 0.5) * 64 - 0.5) / 63, 0, 1)
    assert np.allclose(found[seen], exact[seen], atol=1e-4) and not found[~seen].any()


@pytest.mark.parametrize(
    ("operation", "exact"),
    [
        ("multiply", lambda a, b: a * b),
        ("max", np.maximum),
        ("min", np.minimum),
        ("add", lambda a, b: a + b),
        ("subtract", lambda a, b: a - b),
    ],
)
def test_masks_are_combined(device, operation: str, exact: Any) -> None:
    """Oracle: NumPy, for three inputs of which one is inverted."""
    a, b, c = (
        mask("primvar", name, primvar=RNG.uniform(0, 1, len(POINTS)).astype(np.float32),
             invert=name == "c")
        for name in "abc"
    )  # fmt: skip
    both = mask("masks", "all", inputs=("a", "b", "c"), operation=operation, clamp=False)
    found = values(device, a, b, c, both)
    assert np.allclose(found, exact(exact(a.primvar, b.primvar), 1 - c.primvar), atol=1e-6)


@pytest.mark.parametrize(
    ("ease", "shape"),
    [
        ("linear", lambda t: t),
        ("smooth", lambda t: t * t * (3 - 2 * t)),
        ("smoother", lambda t: t**3 * (t * (6 * t - 15) + 10)),
    ],
)
@pytest.mark.parametrize("invert", [False, True])
def test_values_are_remapped(device, ease: str, shape: Any, invert: bool) -> None:
    """Oracle: the ramp in float64, from a falling input range to -1 and 3."""
    own = mask("primvar", primvar=POINTS[:, 0].copy(), in_min=0.6, in_max=-0.4, out_min=-1.0,
               out_max=3.0, ease=ease, invert=invert)  # fmt: skip
    t = shape(np.clip((POINTS[:, 0] - 0.6) / -1.0, 0, 1))
    exact = 3 - 4 * t if invert else -1 + 4 * t
    assert np.allclose(values(device, own), exact, atol=3e-6)


def test_without_a_clamp_a_line_goes_on(device) -> None:
    """Oracle: the line; from 0..1 to 0..1 the bits stay."""
    own = mask("primvar", primvar=5 * POINTS[:, 0], clamp=False)
    assert np.array_equal(values(device, own), own.primvar)
    own = mask("primvar", primvar=POINTS[:, 0].copy(), in_max=0.5, out_max=3.0, clamp=False)
    assert np.allclose(values(device, own), 6 * POINTS[:, 0], atol=1e-5)


def test_a_mask_is_where_splats_are_only_if_it_asks(device) -> None:
    """Oracle: the coordinate of one set of positions or the other."""
    current = POINTS + np.float32(1)
    resting = values(device, mask("axis", clamp=False), current=current)
    moved = values(device, mask("axis", clamp=False, at="current"), current=current)
    assert np.array_equal(resting, POINTS[:, 1]) and np.array_equal(moved, current[:, 1])


def test_kernels_give_the_same_bits_for_any_number_of_threads() -> None:
    """Oracle: one thread."""
    every = [
        mask("noise", size=0.3, speed=1.0),
        mask("texture", picture=Picture(pixels=RAMP), wrap="repeat"),
        mask("volume", level_set=shell(), falloff=0.5),
    ]
    for own in every:
        one, two = (
            values(CpuDevice(threads=threads), own, seconds=0.3).tobytes() for threads in (1, 2)
        )
        assert one == two
