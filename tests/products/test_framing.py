"""Tests of the pictures that automatic cameras take of real captures."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.delegate.engine import Engine
from usdsplat.interchange.opening import open_capture
from usdsplat.render.settings import RenderSettings

CAPTURES = [
    "splats/flowers_lod2_0.sog", "splats/flowers_lod3_0.sog", "splats/guitar.compressed.ply",
    "splats/playbot_lod2.sog", "splats/playbot_lod6.sog", "splats/pod.spz",
    "splats/statue_angel.compressed.ply", "splats/statue_angel.sog", "splats/statue_massa.sog",
    "splats/statue_trumpet.sog", "seq_synthetic/monkey_0001.sog", "streamed/playbot/lod-meta.json",
]  # fmt: skip


@pytest.mark.parametrize("name", CAPTURES)
@pytest.mark.parametrize("size", [(160, 90), (72, 128)], ids=["wide", "tall"])
def test_a_capture_fills_its_picture_and_is_not_cut(data, name, size):
    """Oracle: the coverage of the picture: rows or columns with 99 % of it are 70 % or more, and no
    edge has more than the soft end of a pedestal."""
    with Engine(open_capture(data / name), device="cpu") as engine:
        picture = engine.picture(engine.view(resolution=size), RenderSettings())
        alpha = picture["color"][..., 3]
    solid = np.where(alpha >= 0.5, alpha, 0)
    spans = []
    for axis in (0, 1):
        reached = np.cumsum(solid.sum(axis=axis)) / solid.sum()
        spans.append(np.ptp(np.searchsorted(reached, (0.005, 0.995))) / len(reached))
    assert max(spans) > 0.7
    edges = (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1])
    assert max((edge > 0.5).mean() for edge in edges) < 0.01
