"""Tests of the ordered contributions to a row of pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.kernels.test_ray_hit import KINDS, cloud_of, found_depth, look
from tests.render.rendering import lens, random_transform
from usdsplat.kernels.bins import TILE
from usdsplat.kernels.contributions import HIT, SPLAT, least_depth
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.project import U, V


@pytest.mark.parametrize("model", ["perspective", "orthographic"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_ray_of_a_tile_hits_a_splat_in_front_of_its_least_depth(kind: str, model: str) -> None:
    """Balls, discs, needles, blades and giants. Oracle: the ray hits at all pixels of each tile;
    and the bound is closer to the nearest of them than the ellipsoid's own depths are."""
    eye = replace(lens(model), size=(60, 44), focal=(60.0, 64.0), center=(28.0, 23.0))
    if model == "orthographic":
        eye = replace(eye, focal=(10.0, 11.0))
    is_parallel = model == "orthographic"
    fields = np.zeros(SPLAT, np.float32)
    gaps, reaches = [], []
    for seed in (1, 2):
        matrix = np.eye(4) if seed == 1 else random_transform(seed)
        seen = look(CpuDevice(), cloud_of(kind, seed, n=20), matrix, eye)
        for record, ray_hit in zip(seen.records, seen.ray_hits, strict=True):
            for left, top in ((0, 0), (16, 16), (48, 32)):
                fields[:2] = record[U] - left, record[V] - top
                fields[HIT : HIT + len(ray_hit) - 1] = ray_hit[:-1]
                least = least_depth(fields, 0, is_parallel)
                hits = [
                    found_depth(record, ray_hit, left + x, top + y, is_parallel)
                    for y in range(0, TILE, 3)
                    for x in range(0, TILE, 3)
                ]
                assert least <= min(hits)
                gaps.append(min(hits) - least)
                reaches.append(ray_hit[6])
    if kind == "flat" and not is_parallel:
        assert np.median(gaps) < 0.5 * np.median(reaches)
