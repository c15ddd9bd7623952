"""Decide whether a picture must be drawn; the renderer draws it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from usdsplat.delegate.render_buffer import RenderBuffer
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.patience import ENDLESS, Patience
from usdsplat.render.renderer import Renderer, TimeSampler
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View


class RenderPass:
    """A pass that draws a view of the render scene into render buffers."""

    def __init__(self, renderer: Renderer, param: RenderParam) -> None:
        self._renderer = renderer
        self._param = param
        self._drawn: tuple[Any, ...] | None = None

    def execute(
        self,
        view: View,
        settings: RenderSettings,
        aovs: tuple[str, ...],
        buffers: Mapping[str, RenderBuffer],
        *,
        sampler: TimeSampler | None = None,
        patience: Patience = ENDLESS,
    ) -> bool:
        """Draw unless the buffers already hold this picture; return whether it was drawn.

        A picture depends only on frozen values and the scene's version, so one comparison decides.
        Pictures that include other times, by `sampler`, are always drawn: an edit at another time
        need not change the scene now. So are pictures after one that lacks nodes of splat trees,
        which may have been read since, or that lacks light. So is a picture that was cancelled.
        """
        wanted = (self._param.version, view, settings, aovs)
        if wanted == self._drawn:
            return False
        self._drawn = None
        self._draw(view, settings, aovs, buffers, sampler, patience)
        stats = self._renderer.stats
        if sampler is None and not stats.missing and not stats.lacks_light:
            self._drawn = wanted
        return True

    def _draw(
        self,
        view: View,
        settings: RenderSettings,
        aovs: tuple[str, ...],
        buffers: Mapping[str, RenderBuffer],
        sampler: TimeSampler | None,
        patience: Patience,
    ) -> None:
        _, top, _, bottom = view.framing.window
        first = True
        scene = self._param.scene
        drawn = self._renderer.render(
            scene, view, settings, aovs, sampler=sampler,
            patience=patience,
        )  # fmt: skip
        for band in drawn:
            is_whole = (band.y0, band.y1) == (top, bottom)
            for name in aovs:
                pixels = band.arrays[name]
                if is_whole and name in band.lasting and pixels.flags.c_contiguous:
                    buffers[name].adopt(pixels)
                    continue
                if first:
                    buffers[name].allocate((bottom - top, *pixels.shape[1:]), pixels.dtype)
                buffers[name].write(band.y0 - top, pixels)
            first = False
