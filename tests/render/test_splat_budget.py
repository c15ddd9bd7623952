"""Tests of a splat budget: which splats are dropped, and what must not change."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.rendering import lens, picture, random_cloud, scene_of, view_of
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edit import take
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import FieldSpec, InstanceSpec
from usdsplat.render.splat_budget import SplatBudget, conspicuousness, most_conspicuous, shares

COUNT = 250
IDS = ("color", "primId", "instanceId", "elementId")


def scene_with(*clouds: tuple[SplatCloud, int]) -> RenderScene:
    """Each cloud as a field with so many instances, side by side."""
    scene = RenderScene()
    for number, (cloud, times) in enumerate(clouds):
        path = f"/field{number}"
        scene.set_field(path, FieldSpec(cloud=cloud))
        placed = []
        for index in range(times):
            matrix = np.eye(4)
            matrix[0, 3] = 0.3 * index - 0.2 * number
            placed.append(
                InstanceSpec(path=path, index=index, transform=tuple(matrix.ravel().tolist()))
            )
        scene.set_instances(path, tuple(placed))
    return scene


def test_what_shows_is_opacity_and_area():
    """Oracle: by hand, with axes in any order; what is not finite shows nothing."""
    cloud = SplatCloud(
        positions=np.zeros((4, 3), np.float32),
        scales=np.array([[1, 2, 3], [3, 1, 2], [0, 5, 1], [1, np.nan, 1]], np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (4, 1)),
        opacities=np.array([1.0, 0.5, 1.0, 1.0], np.float32),
        sh=np.zeros((4, 1, 3), np.float32),
    )
    np.testing.assert_allclose(conspicuousness(cloud), [6, 3, 5, 0])


@pytest.mark.parametrize("count", [0, 1, 2, 5, 99, 100])
def test_the_most_conspicuous_are_kept_and_ties_go_to_the_first(count):
    """Oracle: a stable sort of all, of weights of which most are equal to others."""
    weights = np.random.default_rng(count).integers(0, 7, 100).astype(np.float32)
    expected = np.sort(np.argsort(-weights, kind="stable")[:count])
    np.testing.assert_array_equal(most_conspicuous(weights, count), expected)


def test_a_part_is_kept_until_another_is_asked_for():
    """Oracle: identity, and the rows of the cloud."""
    cloud = random_cloud(1)
    thinning = SplatBudget(cloud)
    part = thinning.part(10)
    assert thinning.part(10) is part
    np.testing.assert_array_equal(part.cloud.positions, cloud.positions[part.rows])
    assert set(part.rows) < set(thinning.part(20).rows)
    assert thinning.part(10) is part  # and one that a movement begins with


@pytest.mark.parametrize("counts", [(10, 40, 3), (40, 10, 3, 39, 60)])
def test_parts_of_a_part_are_those_of_the_cloud(counts):
    """Oracle: the choice among all; of weights of which most are equal to others."""
    cloud = random_cloud(2, n=100)
    cloud.scales[:], cloud.opacities[:] = 1.0, np.float32(np.arange(100) % 7)
    budget = SplatBudget(cloud)
    for count in counts:
        rows = budget.part(count).rows
        np.testing.assert_array_equal(rows, most_conspicuous(conspicuousness(cloud), count))


@pytest.mark.parametrize(
    ("fields", "budget", "expected"),
    [
        ([(100, 1), (300, 1)], 200, [50, 150]),
        ([(100, 2), (200, 1)], 100, [25, 50]),
        ([(3, 1), (1000, 1)], 100, [1, 99]),
        ([(1000, 1), (5, 50)], 100, [50, 1]),
        ([(1000, 1), (5, 200)], 100, [100, 0]),
        ([(10, 1), (20, 1)], 60, [10, 20]),
        ([(10, 1)] * 3, 2, [1, 1, 0]),
    ],
)
def test_fields_share_in_proportion_and_small_ones_stay(fields, budget, expected):
    """Oracle: worked out by hand; no more are kept than the budget."""
    kept = shares(fields, budget)
    assert kept == expected
    assert sum(k * times for k, (_, times) in zip(kept, fields, strict=True)) <= budget


@pytest.mark.parametrize("budget", [0, 4 * COUNT, 10 * COUNT])
def test_a_budget_that_fits_all_changes_no_bit(budget):
    """Oracle: the picture without one, all AOVs."""
    scene = scene_with((random_cloud(1), 3), (random_cloud(2), 1))
    view = view_of(lens())
    plain = picture(scene, view)
    for name, pixels in picture(scene, view, splat_budget=budget).items():
        np.testing.assert_array_equal(pixels, plain[name])


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_ids_are_rows_of_the_prims_own_arrays(sorting):
    """Oracle: a scene whose clouds hold only what the budget keeps, drawn without one; its rows
    are those of the parts."""
    clouds = [(random_cloud(1), 2), (random_cloud(2, n=1500), 1), (random_cloud(3, n=40), 3)]
    budget = 2120 // 2
    kept = shares([(len(cloud), times) for cloud, times in clouds], budget)
    rows = [
        most_conspicuous(conspicuousness(cloud), count)
        for (cloud, _), count in zip(clouds, kept, strict=True)
    ]
    less = [(take(cloud, at), n) for (cloud, n), at in zip(clouds, rows, strict=True)]
    view = view_of(lens())
    aovs = (*IDS, "depth", "Naxis", "albedo", "cryptoObject")
    found = picture(scene_with(*clouds), view, aovs=aovs, splat_budget=budget, sorting=sorting)
    expected = picture(scene_with(*less), view, aovs=aovs, sorting=sorting)
    for name in set(aovs) - {"elementId"}:
        np.testing.assert_array_equal(found[name], expected[name])
    elements = expected["elementId"].copy()
    for prim, at in enumerate(rows):
        own = expected["primId"] == prim
        elements[own] = at[elements[own]]
        assert own.any()
    np.testing.assert_array_equal(found["elementId"], elements)
    assert (found["elementId"] != expected["elementId"]).any()


def test_a_field_that_keeps_nothing_leaves_the_ids_of_others_alone():
    """Oracle: the field that is left drawn alone; its prim is the second of the scene."""
    crowd, other = random_cloud(4, n=5), random_cloud(5, n=100)
    scene = scene_with((crowd, 300), (other, 1))
    view = view_of(lens())
    found = picture(scene, view, aovs=IDS, splat_budget=100)
    expected = picture(scene_with((crowd, 0), (other, 1)), view, aovs=IDS)
    np.testing.assert_array_equal(found["color"], expected["color"])
    np.testing.assert_array_equal(found["elementId"], expected["elementId"])
    assert set(np.unique(found["primId"])) == {-1, 1}


def test_an_edit_of_a_field_thins_it_anew():
    """Oracle: a scene that has held nothing else."""
    scene = scene_with((random_cloud(1), 1))
    view = view_of(lens())
    picture(scene, view, aovs=("color",), splat_budget=100)
    scene.set_field("/field0", FieldSpec(cloud=random_cloud(2)))
    found = picture(scene, view, aovs=("color",), splat_budget=100)["color"]
    fresh = scene_with((random_cloud(2), 1))
    expected = picture(fresh, view, aovs=("color",), splat_budget=100)["color"]
    np.testing.assert_array_equal(found, expected)


def test_a_quarter_of_the_splats_shows_more_than_a_random_quarter():
    """Oracle: the picture of all of them."""
    rng = np.random.default_rng(6)
    cloud = random_cloud(6, n=4000)
    view = view_of(lens())
    whole = picture(scene_of((cloud, np.eye(4))), view, aovs=("color",))["color"]
    chance = take(cloud, np.sort(rng.choice(4000, 1000, replace=False)))
    drawn = picture(scene_of((cloud, np.eye(4))), view, aovs=("color",), splat_budget=1000)
    random = picture(scene_of((chance, np.eye(4))), view, aovs=("color",))
    error, worse = (np.mean((each["color"] - whole) ** 2) for each in (drawn, random))
    assert error < 0.5 * worse  # 3 dB
