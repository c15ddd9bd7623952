"""Tests of the render pass, with a renderer that counts pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from usdsplat.delegate.render_buffer import RenderBuffer
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.render_pass import RenderPass
from usdsplat.render.band import Band
from usdsplat.render.frame_stats import FrameStats
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, View

VIEW = View(camera=CameraSpec(), framing=Framing(resolution=(4, 6), data_window=(1, -1, 5, 5)))


class CountingRenderer:
    """Draws the number of the row, in bands of two, reusing one array as the real one does; or
    whole pictures of which the colour is a copy, as a GPU's is."""

    def __init__(self):
        self.drawn = 0
        self.fails = self.copies = False
        self.stats = FrameStats()

    def render(self, scene, view, settings, aovs, *, sampler, patience):
        self.drawn += 1
        x0, y0, x1, y1 = view.framing.window
        rows = y1 - y0 if self.copies else 2
        color = np.empty((rows, x1 - x0, 4), np.float32)
        depth = np.empty((rows, x1 - x0), np.float32)
        lasting = frozenset({"color"}) if self.copies else frozenset()
        for y in range(y0, y1, rows):
            color[:], depth[:] = self.drawn, np.arange(y, y + rows)[:, None]
            yield Band(y, y + rows, {"color": color, "depth": depth}, lasting)
            depth[:] = np.nan  # not valid any more
            if self.fails:
                raise MemoryError


@pytest.fixture
def drawing():
    renderer, param = CountingRenderer(), RenderParam(RenderScene())
    buffers = {name: RenderBuffer(name) for name in ("color", "depth")}
    return renderer, param, RenderPass(renderer, param), buffers


def test_bands_land_at_their_rows_of_the_data_window(drawing):
    """Oracle: the row numbers that the renderer writes."""
    _, _, render_pass, buffers = drawing
    render_pass.execute(VIEW, RenderSettings(), ("color", "depth"), buffers)
    assert buffers["color"].map().shape == (6, 4, 4)
    np.testing.assert_array_equal(buffers["depth"].map()[:, 0], np.arange(-1, 5))


def test_a_picture_is_drawn_again_only_when_something_it_depends_on_changed(drawing):
    """Oracle: the renderer's count."""
    renderer, param, render_pass, buffers = drawing
    plain = (VIEW, RenderSettings(), ("color", "depth"))
    others = [
        (replace(VIEW, camera=CameraSpec(path="/other")), *plain[1:]),
        (replace(VIEW, framing=replace(VIEW.framing, pixel_aspect_ratio=2.0)), *plain[1:]),
        (VIEW, RenderSettings(sh_degree=1), plain[2]),
        (VIEW, RenderSettings(), ("color",)),
    ]
    assert render_pass.execute(*plain, buffers)
    assert not render_pass.execute(*plain, buffers)
    param.edit()
    assert render_pass.execute(*plain, buffers)
    for other in others:
        assert render_pass.execute(*other, buffers)
        assert not render_pass.execute(*other, buffers)
    assert renderer.drawn == 2 + len(others)


def test_a_picture_that_lacks_nodes_is_drawn_again(drawing):
    """Oracle: the renderer's count. The second picture has them, and is kept."""
    renderer, _, render_pass, buffers = drawing
    for missing in (3, 0, 0):
        renderer.stats = FrameStats(missing=missing)
        render_pass.execute(VIEW, RenderSettings(), ("color",), buffers)
    assert renderer.drawn == 2


def test_a_mapped_picture_cannot_be_written_and_does_not_change_afterwards(drawing):
    """Oracle: the renderer's count, which it writes into the pixels."""
    _, param, render_pass, buffers = drawing
    render_pass.execute(VIEW, RenderSettings(), ("color",), buffers)
    first = buffers["color"].map()
    param.edit()
    render_pass.execute(VIEW, RenderSettings(), ("color",), buffers)
    assert (first == 1).all() and (buffers["color"].map() == 2).all()
    with pytest.raises(ValueError, match="read-only"):
        first[0, 0] = 0


def test_whole_pictures_that_last_are_not_copied(drawing):
    """Oracle: identity of the memory, and the values that the renderer writes: it invalidates what
    does not last."""
    renderer, _, render_pass, buffers = drawing
    renderer.copies = True
    drawn = []
    render = renderer.render
    renderer.render = lambda *a, **k: (drawn.append(band) or band for band in render(*a, **k))
    render_pass.execute(VIEW, RenderSettings(), ("color", "depth"), buffers)
    color, depth = (buffers[name].map() for name in ("color", "depth"))
    assert np.shares_memory(color, drawn[0].arrays["color"]) and not color.flags.writeable
    assert not np.shares_memory(depth, drawn[0].arrays["depth"])
    assert (color == 1).all()
    np.testing.assert_array_equal(depth[:, 0], np.arange(-1, 5))


def test_memory_of_a_picture_is_used_again_when_nothing_refers_to_it(drawing):
    """Oracle: addresses, while pictures or parts of them are held or not."""
    _, param, render_pass, buffers = drawing

    def drawn():
        param.edit()
        render_pass.execute(VIEW, RenderSettings(), ("color",), buffers)
        return buffers["color"].map()

    first = drawn()
    held, before = first[2:4, :, 0], first.ctypes.data
    del first
    assert drawn().ctypes.data != before and (held == 1).all()
    other = drawn().ctypes.data
    assert drawn().ctypes.data == other != before
    last, addresses = drawn(), []
    del held
    for _ in range(4):  # the last picture is held while the next one is drawn
        last = drawn()
        addresses.append(last.ctypes.data)
    assert addresses == [before, other] * 2 and (last == 9).all()


def test_a_picture_that_broke_off_is_drawn_again(drawing):
    """Oracle: the renderer's count."""
    renderer, _, render_pass, buffers = drawing
    renderer.fails = True
    with pytest.raises(MemoryError):
        render_pass.execute(VIEW, RenderSettings(), ("color",), buffers)
    renderer.fails = False
    assert render_pass.execute(VIEW, RenderSettings(), ("color",), buffers)
    assert (buffers["color"].map() == 2).all()
