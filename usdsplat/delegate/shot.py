"""One picture that is being drawn: its samples before any pixel, and the splats of its bands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from usdsplat.delegate import sampling
from usdsplat.delegate.display import displayed
from usdsplat.delegate.frame_stats import Clock, FrameStats
from usdsplat.delegate.holdout import HoldoutRows, hold_back
from usdsplat.delegate.layer import Behind, Layer
from usdsplat.delegate.output import Output
from usdsplat.delegate.plain import PlainPicture, PlainSplats, is_plain
from usdsplat.delegate.render_scene import RenderScene
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.screen import Screen
from usdsplat.delegate.specs import View
from usdsplat.delegate.surface_cache import SurfaceCache
from usdsplat.delegate.surfaces import SurfaceBand, Surfaces
from usdsplat.delegate.visible import Look, Visible, Wanted
from usdsplat.kernels.device import Device

Moment = tuple[RenderScene, View]
Moments = Callable[[float], Moment]
"""The scene and the view at a time [time code] relative to the frame; 0 goes back to it."""
Holdout = Callable[[int, int, int, int], HoldoutRows]
"""What an external holdout has in the pixels x0, y0, x1, y1."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """One sample of a view before any pixel."""

    screen: Screen
    seen: Visible | PlainSplats
    """All that is to be known of each splat, or a whole picture of nothing but colour."""
    surfaces: Surfaces | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shot:
    """One picture that is being drawn: what all its bands and samples share."""

    device: Device
    surface_cache: SurfaceCache
    moments: Moments
    settings: RenderSettings
    aovs: tuple[str, ...]
    blend_space: str
    output: Output
    holdout: Holdout | None
    scratch: Scratch
    stats: FrameStats
    clock: Clock

    def prepare(
        self,
        sample: sampling.Sample,
        window: tuple[int, int, int, int],
        aovs: tuple[str, ...],
    ) -> Prepared:
        """What comes before any pixel of a sample, as far as `aovs` need it in `window`."""
        scene, view = self.moments(sample.time)
        screen = replace(Screen.of(view), window=window).through(
            sample.lens, view.camera.focus_distance, sample.offset
        )
        surfaces = Surfaces.of(self.device, scene, screen, view.matte, cache=self.surface_cache)
        self.clock.lap("surfaces")
        by_ray, mode = self.settings.sorting == "rayHitDistance", self.settings.display_mode
        wanted = Wanted(
            peaks=by_ray or surfaces is not None or self.holdout is not None,
            features=bool({"Neye", "albedo", "depthExpected"} & set(aovs)) or mode == "normals",
            labels="cryptoObject" in aovs,
        )
        look = Look(self.device, self.scratch, scene, screen, self.settings, self.blend_space)
        is_bare = surfaces is None and self.holdout is None and set(aovs) == {"color"}
        if self.device.name == "cuda" and is_bare and is_plain(look, view.matte):
            drawn = self.scratch.made("plain", lambda: PlainPicture(self.device))
            plain = drawn.draw(look, self.stats)
            self.clock.lap("frame")
            if plain is not None:
                return Prepared(screen, plain, None)
        seen = look.take(wanted, view.matte, self.stats, self.clock)
        if mode != "splats":
            scale = view.framing.pixel_scale
            seen = displayed(self.device, self.scratch, seen, mode, scale)
            if mode == "ellipses":  # each is there twice, once as its rim
                self.stats.visible = seen.order.shape[0] // 2
            self.clock.lap("display")
        return Prepared(screen, seen, surfaces)

    def layer(
        self, prepared: Prepared, y0: int, y1: int
    ) -> tuple[Layer, Behind, SurfaceBand | None]:
        """The splats of a band, and what is behind them."""
        assert isinstance(prepared.seen, Visible)
        x0, _, x1, _ = prepared.screen.window
        drawn = None
        behind = Behind()
        if prepared.surfaces is not None:
            drawn = prepared.surfaces.draw(y0, y1, self.scratch)
            behind = Behind(drawn.depth, drawn.covered)
            self.clock.lap("surfaces")
        if self.holdout is not None:
            rows = self.holdout(x0, y0, x1, y1)
            behind = hold_back(self.device, self.scratch, behind, rows, (y1 - y0, x1 - x0))
        layer = Layer(
            self.device,
            self.scratch,
            prepared.seen,
            (x0, y0, x1, y1),
            by_ray=self.settings.sorting == "rayHitDistance",
            behind=behind,
            stats=self.stats,
        )
        self.clock.lap("bins")
        return layer, behind, drawn
