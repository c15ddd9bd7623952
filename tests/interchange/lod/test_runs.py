"""Tests of sorted runs in files."""

from __future__ import annotations

import numpy as np

from tests.formats.samples import random_cloud
from usdsplat.core import edit, morton
from usdsplat.interchange.lod.runs import Cube, Runs, cloud_of, has_run, rows_of, write_run

CUBE = Cube(low=np.full(3, -4.0), edge=8.0)
NAMES = ("positions", "scales", "rotations", "opacities", "sh")


def test_all_rows_come_back_in_the_order_of_their_keys(tmp_path):
    """Oracle: NumPy's stable sort of all keys at once, by input order where keys are equal."""
    cloud = random_cloud(300, 1)
    cloud.positions[100:150] = cloud.positions[5]  # equal keys in all runs
    paths = [tmp_path / f"{k}" for k in range(3)]
    for path, rows in zip(paths, np.split(np.arange(300), (20, 140)), strict=True):
        write_run(path, edit.take(cloud, rows), CUBE)
        assert has_run(path)
    runs = Runs(paths, 1)
    keys = morton.keys(cloud.positions, CUBE.low, CUBE.edge)
    order = np.argsort(keys, kind="stable")
    found = runs.gather(np.zeros(3, np.int64), runs.counts)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(found, name), getattr(cloud, name)[order])


def test_a_range_of_keys_is_found_in_each_run(tmp_path):
    """Oracle: a comparison with each key."""
    clouds = [random_cloud(200, 0, seed) for seed in (1, 2)]
    paths = [tmp_path / "a", tmp_path / "b"]
    for path, cloud in zip(paths, clouds, strict=True):
        write_run(path, cloud, CUBE)
    runs = Runs(paths, 0)
    keys = [morton.keys(cloud.positions, CUBE.low, CUBE.edge) for cloud in clouds]
    edges = np.sort(np.concatenate(keys))[[40, 300]]
    rows = runs.below(edges)
    np.testing.assert_array_equal(rows, [[(k < edge).sum() for edge in edges] for k in keys])
    part = runs.gather(rows[:, 0], rows[:, 1])
    found = morton.keys(part.positions, CUBE.low, CUBE.edge)
    assert len(part) == 260
    assert (np.diff(found.astype(np.int64)) >= 0).all()
    assert found.min() >= edges[0] and found.max() < edges[1]


def test_an_empty_run_has_no_rows(tmp_path):
    """Oracle: the number of rows."""
    write_run(tmp_path / "e", edit.take(random_cloud(3, 2), np.arange(0)), CUBE)
    runs = Runs([tmp_path / "e"], 2)
    assert runs.counts.tolist() == [0]
    assert runs.gather(np.zeros(1, np.int64), runs.counts).sh.shape == (0, 9, 3)


def test_records_hold_all_numbers():
    """Oracle: the cloud."""
    cloud = random_cloud(5, 3)
    again = cloud_of(rows_of(cloud))
    for name in NAMES:
        np.testing.assert_array_equal(getattr(again, name), getattr(cloud, name))
