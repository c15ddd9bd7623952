"""Tests of the cache of textures."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Sdf

from usdsplat.delegate.scene_delegate.textures import Textures


@pytest.fixture
def asset(tmp_path: Path) -> Sdf.AssetPath:
    """A picture of 2x2 pixels."""
    path = str(tmp_path / "a.exr")
    oiio.ImageBuf(np.full((2, 2, 3), 0.5, np.float32)).write(path)
    return Sdf.AssetPath(path, path)


def test_a_texture_that_nobody_shows_any_more_is_let_go_of(asset: Sdf.AssetPath) -> None:
    """A texture that nobody shows any more is let go of, so animated ones do not pile up; while
    it is shown it is read once. Oracle: weak references."""
    textures = Textures()
    kept = textures.read(asset, "raw")
    assert textures.read(asset, "raw") is kept
    biased = [
        weakref.ref(
            textures.read_biased(asset, "raw", scale=(1.0, 1.0, 1.0), bias=(bias, 0.0, 0.0))
        )
        for bias in (0.1, 0.2)
    ]
    plain = weakref.ref(kept)
    del kept
    gc.collect()
    assert plain() is None
    assert [each() for each in biased] == [None, None]
