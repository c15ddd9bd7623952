"""Render pictures of scenes on one device, with checks, buffer reuse and a fallback to the CPU."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from usdsplat.core.errors import BackendError, UsageError
from usdsplat.images.aovs import LIGHT, is_light
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.render import sampling
from usdsplat.render.aov_resolver import AVERAGED
from usdsplat.render.band import BAND_PIXELS, Band
from usdsplat.render.cpu import CpuRasterizer
from usdsplat.render.deep_memory import USUAL_SIZE, DeepSize
from usdsplat.render.deep_merging import merges_deep, render_merged_deep
from usdsplat.render.deep_samples import DEEP_IDS, DeepSamples
from usdsplat.render.frame import MOTION, render_deep, render_frame
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.frame_context import FrameContext, Moment, TimeSampler
from usdsplat.render.frame_stats import Clock, FrameStats
from usdsplat.render.lod.nodes import PictureNodes, nodes_of
from usdsplat.render.occluders import ReadHoldout, remembering
from usdsplat.render.output import DISPLAY_SPACE, Output
from usdsplat.render.patience import ENDLESS, Patience
from usdsplat.render.rasterizer import Rasterizer
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, View
from usdsplat.render.surface_cache import SurfaceCache

AOVS = (
    *AVERAGED,
    "depth",
    "depthFront",
    "depthExpected",
    "Neye",
    "Naxis",
    "confidence",
    "occlusion",
    "P",
    "primId",
    "instanceId",
    "elementId",
    "motionForward",
    "motionBackward",
)
"""AOVs that can be rendered, under Hydra's names where Hydra has one. See `images.aovs` for their
meaning.

`color` is premultiplied RGBA in the output space. `depth` is the planar camera depth at which half
of the pixel's own coverage, surfaces included, is reached. The ids are those of the splat or
surface at that depth, -1 where nothing is: `primId` is the index of the prim in the sorted paths of
drawn prims, `instanceId` the number within a point instancer, `elementId` a splat's row in its
prim's arrays or a mesh's face."""

ORDERED = ("zDepth", "rayHitDistance")
"""Sorting modes of deep pictures: those that sort by planar depth."""


@dataclass(frozen=True, slots=True, eq=False)
class _Workspace:
    """Rasterizer and buffers of one picture, from its first band to its last."""

    rasterizer: Rasterizer
    surface_cache: SurfaceCache
    buffers: FrameBuffers

    @property
    def device(self) -> Device:
        return self.rasterizer.device

    def frame(
        self,
        sampler: TimeSampler,
        settings: RenderSettings,
        aovs: tuple[str, ...],
        blend_space: str,
        output: Output,
        holdout: ReadHoldout | None,
        nodes: PictureNodes | None,
        patience: Patience = ENDLESS,
    ) -> FrameContext:
        """Return the context of a new picture."""
        stats = FrameStats()
        if nodes is not None:
            stats = FrameStats(of_trees=nodes.cut.splats, missing=nodes.missing)
        return FrameContext(
            rasterizer=self.rasterizer
            if patience.cancel is None
            else self.rasterizer.until(patience.cancel),
            surface_cache=self.surface_cache,
            sampler=sampler,
            settings=settings,
            aovs=aovs,
            blend_space=blend_space,
            output=output,
            holdout=None if holdout is None else remembering(holdout),
            nodes=nodes,
            buffers=self.buffers,
            stats=stats,
            clock=Clock(stats, patience.token),
            patience=patience,
        )


class Renderer:
    """Renderer of views on one device. It keeps buffers between pictures, not scenes.

    Args:
        falls_back: Whether the CPU draws the remaining bands if a GPU fails.
    """

    def __init__(self, device: Device, *, falls_back: bool = False) -> None:
        self._rasterizer = open_rasterizer(device)
        self._falls_back = falls_back
        self._idle: list[FrameBuffers] = []
        self._closed = False
        self._surface_cache = SurfaceCache()
        self.stats = FrameStats()
        """Statistics of the last picture."""

    @property
    def _device(self) -> Device:
        return self._rasterizer.device

    @property
    def device(self) -> str:
        """Name of the device that draws."""
        return self._device.name

    @property
    def remark(self) -> str:
        """Reason why a faster device is not used, for the user; usually empty."""
        return self._device.remark

    def close(self) -> None:
        """Release the buffers. Those of a picture in progress are released after its last band."""
        self._closed = True
        self._idle.clear()
        self._surface_cache = SurfaceCache()
        self._device.close()

    def render(
        self,
        scene: RenderScene,
        view: View,
        settings: RenderSettings,
        aovs: tuple[str, ...],
        *,
        sampler: TimeSampler | None = None,
        holdout: ReadHoldout | None = None,
        band_pixels: int = BAND_PIXELS,
        patience: Patience = ENDLESS,
    ) -> Iterator[Band]:
        """Draw the data window of `view`, band by band from the top.

        Args:
            settings: Settings in which only `rasterize_mode` may be auto.
            aovs: Names in AOVS, or of AOVs of light groups, see `images.aovs`. With those, splats
                are blended in the working space, in which the picture is too: only then colours are
                sums of their parts.
            sampler: Scene and view at other times, for motion; None for a static scene.
            holdout: External holdout that hides splats and surfaces.
            band_pixels: Approximate number of pixels of a band.
            patience: What the picture waits for, and what ends it.

        Raises:
            UsageError: If an AOV is unknown, the view has no area, or the OCIO view does not exist.
        """
        for name in aovs:
            if name not in AOVS and not is_light(name):
                raise UsageError("AOV", repr(name), f"one of {', '.join(AOVS)}, {LIGHT}GROUP")
        if any(map(is_light, aovs)):
            settings = replace(settings, blend_space="linear", color_mode="scene")
        screen = Screen.of(view)
        blend_space = blend_space_of(scene, settings)
        _output(
            self._device, settings, blend_space, view
        )  # raises errors now, not at the first band

        def still(_: float) -> Moment:
            return scene, view

        def bands(workspace: _Workspace, taken: int) -> Iterator[Band]:
            output = _output(workspace.device, settings, blend_space, view)
            nodes = nodes_of(scene, sampler or still, settings, _plan(settings, view.camera))
            frame = workspace.frame(
                sampler or still,
                settings,
                aovs,
                blend_space,
                output,
                holdout,
                nodes,
                patience,
            )
            drawn = render_frame(frame, view.camera, screen, band_pixels)
            for band in itertools.islice(drawn, taken, None):
                frame.stats.failed, frame.stats.asked = output.failed, output.covered
                self.stats = frame.stats
                yield replace(band, arrays={name: band.arrays[name] for name in aovs})
                frame.clock.resume()

        return self._borrowing(bands)

    def render_deep(
        self,
        scene: RenderScene,
        view: View,
        settings: RenderSettings,
        aovs: tuple[str, ...] = (),
        *,
        sampler: TimeSampler | None = None,
        holdout: ReadHoldout | None = None,
        size: DeepSize = USUAL_SIZE,
    ) -> Iterator[tuple[int, int, DeepSamples]]:
        """Return the contributions to every pixel, in strips of a band: (y0, y1, samples).

        Samples stay valid as long as anything refers to their arrays. Memory of those that are
        released is used for the strips that follow.

        The picture is blended in the working space. Surfaces are opaque samples. Those of all
        samples of shutter, lens and pixel are merged.

        Args:
            aovs: Ids that samples need, of `deep_samples.DEEP_IDS`; samples with different ids are
                never merged.

        Raises:
            UsageError: If splats are not sorted by planar depth, an AOV is not an id, or a row of
                pixels or one pixel has too many samples.
        """
        for name in aovs:
            if name not in DEEP_IDS:
                raise UsageError("deep AOV", repr(name), f"one of {', '.join(DEEP_IDS)}")
        ids = tuple(name for name in DEEP_IDS if name in aovs)
        if settings.sorting not in ORDERED:
            expected = f"{' or '.join(ORDERED)} for a deep picture"
            raise UsageError("sorting", settings.sorting, expected)
        settings = replace(settings, blend_space="linear", color_mode="scene")
        screen = Screen.of(view)
        blend_space = settings.working_space
        merges = merges_deep(settings, len(ids))
        x0, top, x1, bottom = screen.window

        def still(_: float) -> Moment:
            return scene, view

        def bands(workspace: _Workspace, taken: int) -> Iterator[tuple[int, int, DeepSamples]]:
            nonlocal top
            output = _output(workspace.device, settings, blend_space, view)
            nodes = nodes_of(scene, sampler or still, settings, _plan(settings, view.camera))
            frame = workspace.frame(
                sampler or still, settings, ids, blend_space, output, holdout, nodes
            )
            if merges:  # the heights of strips depend on what is drawn: begin after the last one
                rest = replace(screen, window=(x0, top, x1, bottom))
                strips = render_merged_deep(
                    frame, view.camera, rest, size.band_pixels, size.entries
                )
            else:
                drawn = render_deep(frame, view.camera, screen, size.band_pixels)
                strips = itertools.islice(drawn, taken, None)
            for each in strips:
                self.stats = frame.stats
                yield each
                top = each[1]
                frame.clock.resume()

        return self._borrowing(bands)

    # --- private ---------------------------------------------------------------------------

    def _borrowing(self, bands: Callable[[_Workspace, int], Iterator[Any]]) -> Iterator[Any]:
        """Run a generator with its own buffers, which later pictures reuse.

        If a GPU fails and `falls_back` is set, the CPU draws the remaining bands.

        Args:
            bands: Returns the bands, without the given number of them that was drawn already.
        """
        workspace = self._take_workspace()
        taken = 0
        try:
            for band in bands(workspace, 0):
                taken += 1
                yield band
        except BackendError as error:
            if not self._falls_back or workspace.device.name == "cpu":
                raise
            self._fall_back(workspace.device, error)
            workspace = self._take_workspace()
            yield from bands(workspace, taken)
        finally:
            if not self._closed and workspace.device is self._device:
                self._idle.append(workspace.buffers)

    def _take_workspace(self) -> _Workspace:
        buffers = self._idle.pop() if self._idle else FrameBuffers(self._device.resident)
        return _Workspace(self._rasterizer, self._surface_cache, buffers)

    def _fall_back(self, failed: Device, error: BackendError) -> None:
        """Use the CPU from now on, unless another picture has switched already."""
        if self._device is not failed:
            return
        remark = f"{error}; the CPU is used"
        self._rasterizer = open_rasterizer(CpuDevice(threads=failed.threads, remark=remark))
        self._idle.clear()
        self._surface_cache = SurfaceCache()
        failed.close()


def open_rasterizer(device: Device) -> Rasterizer:
    """Return the rasterizer of a device."""
    if device.name == "cuda":
        from usdsplat.kernels.cuda.device import CudaDevice

        if isinstance(device, CudaDevice):
            from usdsplat.render.cuda import CudaRasterizer

            return CudaRasterizer(device)
    return CpuRasterizer(device)


def depends_on_time(settings: RenderSettings, camera: CameraSpec, aovs: tuple[str, ...]) -> bool:
    """Return whether a picture depends on other times than its own."""
    begin, end = camera.shutter
    blurred = settings.samples > 1 and settings.motion_blur and (begin != 0 or end != 0)
    return blurred or bool(MOTION & set(aovs))


def blend_space_of(scene: RenderScene, settings: RenderSettings) -> str:
    """Return the space in which splats are blended.

    For linear blending it is the working space. Otherwise it is the training space of the captures,
    or sRGB if their training spaces differ.
    """
    if settings.blend_space == "linear":
        return settings.working_space
    spaces = scene.color_spaces()
    return spaces.pop() if len(spaces) == 1 else DISPLAY_SPACE


def _plan(settings: RenderSettings, camera: CameraSpec) -> tuple[sampling.Sample, ...]:
    """Return all samples for which nodes of splat trees are chosen."""
    return *sampling.samples(settings, camera), sampling.center(settings, camera)


def _output(device: Device, settings: RenderSettings, blend_space: str, view: View) -> Output:
    return Output(device, settings, blend_space, view.camera.exposure)
