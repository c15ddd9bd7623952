"""Tests of pictures of refined captures."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.refinement import UPRIGHT, Gallery, psnr, views
from usdsplat import formats
from usdsplat.core import edit
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer
from usdsplat.sim.refining import refined


@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_a_refined_capture_draws_like_the_capture(data: Path, mode) -> None:
    """Oracle: pictures of the capture, of which splats that are divided make up a third or more;
    along each ray 45 dB, and 40 where whole splats are sorted by their depth.
    """
    capture = formats.read(data / "splats" / "playbot_lod4.sog").cloud
    capture = edit.transform(capture, UPRIGHT)
    device = open_device()
    gallery = Gallery(Renderer(device), list(views(capture, (320, 180))))
    limit = 0.05
    assert gallery.share(capture, limit) > 0.3
    some, _ = refined(device, capture, limit=limit)
    assert len(some) > 1.5 * len(capture)
    for sorting, least in (("rayHitDistance", 45), ("zDepth", 40)):
        pairs = zip(
            gallery.drawn(some, mode, sorting), gallery.drawn(capture, mode, sorting), strict=True
        )
        assert min(psnr(*pair) for pair in pairs) > least
