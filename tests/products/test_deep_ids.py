"""Tests of ids and Cryptomattes of deep samples, as files have them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from usdsplat.images.cryptomatte import object_hash
from usdsplat.products import deep_ids
from usdsplat.products.deep_ids import DeepIds
from usdsplat.products.request import PicturePlan
from usdsplat.render.deep_samples import DeepSamples
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing


def test_prims_are_hashed_once_while_strips_have_the_same(monkeypatch):
    """Oracle: the number of calls, the hashes, and the numbers of the file; other prims of a later
    strip are hashed too."""
    hashed: list[str] = []
    monkeypatch.setattr(
        deep_ids, "object_hash", lambda path: hashed.append(path) or object_hash(path)
    )
    info = SimpleNamespace(prims=("/a", "/b", "/c"))
    plan = PicturePlan(
        camera=None,
        framing=Framing(),
        settings=RenderSettings(),
        aovs=("color", "Z", "id", "cryptoObject"),
        purposes=(),
    )
    ids = DeepIds(SimpleNamespace(stage_info=lambda: info), plan)
    depth, one = np.float32([1, 2, 3]), np.ones((1, 1), np.float32)
    samples = DeepSamples(
        np.uint32([[3]]), depth, depth, np.full((3, 4), 0.5, np.float32), one,
        np.int32([[1], [0], [1]]), ("primId",), ("/c", "/a"),
    )  # fmt: skip
    for prims, calls in ((("/c", "/a"), 2), (("/c", "/a"), 2), (("/b", "/c"), 4)):
        found = ids.channels(replace(samples, prims=(*prims,)))
        paths = [prims[k] for k in (1, 0, 1)]
        np.testing.assert_array_equal(found["cryptoObject00.R"], [*map(object_hash, paths)])
        assert found["id"].tolist() == [info.prims.index(path) for path in paths]
        assert len(hashed) == calls
