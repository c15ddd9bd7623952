"""Values that all bands and samples of one picture share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.render.draw_list import DrawList
from usdsplat.render.fields import Drawn
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.frame_stats import Clock, FrameStats
from usdsplat.render.lights.lighting import Lighting
from usdsplat.render.lights.paints import LightPaints
from usdsplat.render.lod.nodes import PictureNodes
from usdsplat.render.matte_groups import MatteGroups
from usdsplat.render.occluders import ReadHoldout
from usdsplat.render.output import Output
from usdsplat.render.patience import ENDLESS, Patience
from usdsplat.render.projected_splats import ProjectedSplats
from usdsplat.render.rasterizer import Rasterizer, WholeImage
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View
from usdsplat.render.surface_cache import SurfaceCache
from usdsplat.render.surfaces import Surfaces

Moment = tuple[RenderScene, View]
TimeSampler = Callable[[float], Moment]
"""Return the scene and the view at a time [time code] relative to the frame. 0 returns the scene to
the frame."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameSample:
    """One sample of a picture, ready to be rasterized."""

    screen: Screen
    splats: ProjectedSplats | WholeImage
    """The splats in order of depth, or the finished picture of a device that fuses the steps."""
    surfaces: Surfaces | None
    """The scene's meshes; None if there are none."""
    groups: Mapping[str, MatteGroups]
    """Requested layer of Cryptomatte -> its groups."""
    lighting: Lighting | None = None
    """Light of the scene; None if nothing depends on it."""
    shadows: tuple[F32, F32 | None] | None = None
    """Rows of features with the ratios of light, see `LightPaints.ratios`, and weights of
    the splats that count, None for all but mattes; None if they are not needed."""
    paints: LightPaints | None = None
    """Light on the splats; None if no AOV needs it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameContext:
    """Values that all bands and samples of one picture share."""

    rasterizer: Rasterizer
    surface_cache: SurfaceCache
    sampler: TimeSampler
    settings: RenderSettings
    aovs: tuple[str, ...]
    blend_space: str
    """Colour space in which splats are blended."""
    output: Output
    holdout: ReadHoldout | None
    nodes: PictureNodes | None
    """The nodes of splat trees; None without trees."""
    buffers: FrameBuffers
    stats: FrameStats
    clock: Clock
    patience: Patience = ENDLESS

    def layout(self, scene: RenderScene, fade: tuple[float, float]) -> DrawList:
        """Return the splats of a sample, see `PictureNodes.layout`."""
        if self.nodes is None:
            return scene.draw_list(self.settings.splat_budget)
        return self.nodes.layout(scene, fade)

    def drawn(self, scene: RenderScene) -> Sequence[Drawn]:
        """Return each appearance of splats, in the order of the layout."""
        return scene.drawn() if self.nodes is None else self.nodes.drawn(scene)

    @property
    def device(self) -> Device:
        """The device that draws."""
        return self.rasterizer.device

    @property
    def sorts_by_ray_hit(self) -> bool:
        """Whether the splats of each pixel are sorted by their ray hits."""
        return self.settings.sorting == "rayHitDistance"
