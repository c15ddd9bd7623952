"""From a render scene and a view to bands of pixels: the order of the stages, and nothing else.

surfaces, look           once per sample of a view, see `Surfaces` and `Look`
layer                    once per band: lists of tiles, then whatever is asked for
output, over             splats and surfaces in the picture's space, one over the other
sums                     the average over all samples

A sample is a sharp picture at one time through one point of the lens. Colours, albedo and mattes
are averaged; all else is read from the sample in the middle and never mixed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import BackendError, UsageError
from usdsplat.delegate import sampling
from usdsplat.delegate.band import Band
from usdsplat.delegate.frame_stats import Clock, FrameStats
from usdsplat.delegate.holdout import remembering
from usdsplat.delegate.layer import DeepSamples
from usdsplat.delegate.motion import Motion
from usdsplat.delegate.output import DISPLAY_SPACE, Output
from usdsplat.delegate.painter import AVERAGED, Painter
from usdsplat.delegate.render_scene import RenderScene
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.screen import Screen
from usdsplat.delegate.shot import Holdout, Moment, Moments, Prepared, Shot
from usdsplat.delegate.specs import CameraSpec, View
from usdsplat.delegate.sums import Sums
from usdsplat.delegate.surface_cache import SurfaceCache
from usdsplat.kernels import surface
from usdsplat.kernels.device import CpuDevice, Device

AOVS = (
    *AVERAGED,
    "depth",
    "depthFront",
    "depthExpected",
    "Neye",
    "P",
    "primId",
    "instanceId",
    "elementId",
    "motionForward",
    "motionBackward",
)
"""What can be rendered, in Hydra's words where it has one; `images.aovs` says what each means.

`color` is premultiplied RGBA in the output space. `depth` is the planar camera depth at which half
of the pixel's own coverage, surfaces included, is passed; the ids are those of what passes it, -1
where nothing is: `primId` counts the drawn prims in the order of their paths, `instanceId` is the
number within a point instancer, `elementId` a splat's row in its prim's arrays or a mesh's face."""

BAND_PIXELS = 1 << 21
"""[pixel] of a band: a 1920x1080 picture is one band, a 3840x2160 one four."""
MOTION = {"motionForward", "motionBackward"}
"""AOVs that look at the neighbouring frames."""
ORDERED = ("zDepth", "rayHitDistance")
"""Orders in which a deep picture's samples can be kept: those of planar depths."""


@dataclass(frozen=True, slots=True, eq=False)
class _Desk:
    """What one picture is drawn with, from its first band to its last."""

    device: Device
    surface_cache: SurfaceCache
    scratch: Scratch


class Renderer:
    """Draws views of render scenes on one device. It keeps buffers between pictures, not scenes.

    Args:
        falls_back: Whether the CPU draws the rest if a GPU fails.
    """

    def __init__(self, device: Device, *, falls_back: bool = False) -> None:
        self._device = device
        self._falls_back = falls_back
        self._idle: list[Scratch] = []
        self._closed = False
        self._surface_cache = SurfaceCache()
        self.stats = FrameStats()
        """Of the last picture."""

    @property
    def device(self) -> str:
        """Name of what draws."""
        return self._device.name

    @property
    def remark(self) -> str:
        """Why it is not the fastest that this machine could have; mostly empty."""
        return self._device.remark

    def close(self) -> None:
        """Release the buffers; those of a picture that is being drawn go with its last band."""
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
        moments: Moments | None = None,
        holdout: Holdout | None = None,
        band_pixels: int = BAND_PIXELS,
    ) -> Iterator[Band]:
        """Draw the data window of `view`, band after band from the top.

        Args:
            settings: With nothing left on auto but `rasterize_mode`.
            aovs: Which of AOVS.
            moments: Scene and view at other times, for motion; None for a scene that stands still.
            holdout: What else hides splats and surfaces, and is not in the picture.
            band_pixels: About how many pixels to draw at a time.

        Raises:
            UsageError: If an AOV is unknown, the view has no area, or there is no such OCIO view.
        """
        for name in aovs:
            if name not in AOVS:
                raise UsageError("AOV", repr(name), f"one of {', '.join(AOVS)}")
        screen = Screen.of(view)
        blend_space = blend_space_of(scene, settings)
        _output(self._device, settings, blend_space, view)  # refused now, not at the first band

        def still(_: float) -> Moment:
            return scene, view

        def bands(desk: _Desk) -> Iterator[Band]:
            stats = FrameStats()
            output = _output(desk.device, settings, blend_space, view)
            shot = Shot(
                device=desk.device,
                surface_cache=desk.surface_cache,
                moments=moments or still,
                settings=settings,
                aovs=aovs,
                blend_space=blend_space,
                output=output,
                holdout=None if holdout is None else remembering(holdout),
                scratch=desk.scratch,
                stats=stats,
                clock=Clock(stats),
            )
            for y0, y1, arrays in self._rows(shot, screen, view, band_pixels):
                stats.failed, stats.asked = output.failed, output.covered
                self.stats = stats
                yield Band(y0, y1, {name: arrays[name] for name in aovs})
                shot.clock.resume()

        return self._borrowing(bands)

    def render_deep(
        self,
        scene: RenderScene,
        view: View,
        settings: RenderSettings,
        *,
        holdout: Holdout | None = None,
        band_pixels: int = BAND_PIXELS,
    ) -> Iterator[tuple[int, int, DeepSamples]]:
        """Return the contributions to every pixel, band after band: (y0, y1, samples).

        Blended in the working space, one sharp sample. Surfaces are samples that hide all behind.

        Raises:
            UsageError: If the order of splats is not one of planar depths.
        """
        if settings.sorting not in ORDERED:
            expected = f"{' or '.join(ORDERED)} for a deep picture"
            raise UsageError("sorting", settings.sorting, expected)
        settings = replace(settings, samples=1, blend_space="linear", color_mode="scene")
        screen = Screen.of(view)
        blend_space = settings.working_space

        def bands(desk: _Desk) -> Iterator[tuple[int, int, DeepSamples]]:
            stats = FrameStats()
            output = _output(desk.device, settings, blend_space, view)
            shot = Shot(
                device=desk.device,
                surface_cache=desk.surface_cache,
                moments=lambda _: (scene, view),
                settings=settings,
                aovs=(),
                blend_space=blend_space,
                output=output,
                holdout=None if holdout is None else remembering(holdout),
                scratch=desk.scratch,
                stats=stats,
                clock=Clock(stats),
            )
            prepared = shot.prepare(sampling.Sample(), screen.window, ())
            for y0, y1 in screen.bands(band_pixels):
                layer, _, drawn = shot.layer(prepared, y0, y1)
                samples = layer.deep(settings.deep_error)
                if view.camera.exposure != 1.0:
                    samples.color[:, :3] *= np.float32(view.camera.exposure)
                if drawn is not None:
                    fetch = desk.device.fetch
                    is_drawn = fetch(drawn.covered) == surface.DRAWN
                    color = fetch(output.surfaces(drawn.color))
                    samples = samples.with_surfaces(fetch(drawn.depth), is_drawn, color)
                shot.clock.lap("deep")
                self.stats = stats
                yield y0, y1, samples
                shot.clock.resume()

        return self._borrowing(bands)

    # --- private ---------------------------------------------------------------------------

    def _borrowing(self, bands: Callable[[_Desk], Iterator[Any]]) -> Iterator[Any]:
        """Run a generator with buffers of its own; the next picture uses them again. If a GPU fails
        and the CPU may take over, the CPU draws the remaining bands."""
        desk = self._desk()
        taken = 0
        try:
            for band in bands(desk):
                taken += 1
                yield band
        except BackendError as error:
            if not self._falls_back or desk.device.name == "cpu":
                raise
            self._fall_back(desk.device, error)
            desk = self._desk()
            yield from itertools.islice(bands(desk), taken, None)
        finally:
            if not self._closed and desk.device is self._device:
                self._idle.append(desk.scratch)

    def _desk(self) -> _Desk:
        scratch = self._idle.pop() if self._idle else Scratch(self._device.resident)
        return _Desk(self._device, self._surface_cache, scratch)

    def _fall_back(self, failed: Device, error: BackendError) -> None:
        """Draw with the CPU from now on, unless another picture has switched already."""
        if self._device is not failed:
            return
        self._device = CpuDevice(threads=failed.threads, remark=f"{error}; the CPU does the work")
        self._idle.clear()
        self._surface_cache = SurfaceCache()
        failed.close()

    def _rows(
        self, shot: Shot, screen: Screen, view: View, band_pixels: int
    ) -> Iterator[tuple[int, int, dict[str, npt.NDArray[Any]]]]:
        """Bands of a picture, whatever the number of its samples."""
        plan = sampling.samples(shot.settings, view.camera)
        center = sampling.center(shot.settings, view.camera)
        painter = Painter(shot)
        if len(plan) == 1:
            prepared = shot.prepare(center, screen.window, shot.aovs)
            motion = self._motion(shot, prepared, center)
            for y0, y1 in screen.bands(band_pixels):
                drawn = painter.draw(prepared, motion, y0, y1, shot.aovs)
                yield y0, y1, _fetched(shot.device, drawn)
            return
        for y0, y1 in screen.bands(band_pixels):
            try:
                arrays = self._averaged(shot, painter, plan, center, screen, y0, y1)
            finally:  # also from a time at which something cannot be drawn
                shot.moments(0.0)
            yield y0, y1, arrays

    def _averaged(
        self,
        shot: Shot,
        painter: Painter,
        plan: tuple[sampling.Sample, ...],
        center: sampling.Sample,
        screen: Screen,
        y0: int,
        y1: int,
    ) -> dict[str, npt.NDArray[Any]]:
        """One band of many samples; leaves the scene at the last one's time."""
        averaged = tuple(name for name in shot.aovs if name in AVERAGED)
        read = tuple(name for name in shot.aovs if name not in AVERAGED)
        x0, _, x1, _ = screen.window
        window = x0, y0, x1, y1
        arrays: dict[str, npt.NDArray[Any]] = {}
        if read:
            prepared = shot.prepare(center, window, read)
            motion = self._motion(shot, prepared, center)
            arrays |= _fetched(shot.device, painter.draw(prepared, motion, y0, y1, read))
        if averaged:
            sums = Sums(shot.device, shot.scratch, (y1 - y0, x1 - x0), averaged)
            for sample in plan:
                prepared = shot.prepare(sample, window, averaged)
                arrays_of_one = painter.draw(prepared, None, y0, y1, averaged, raw=True)
                sums.add(arrays_of_one, prepared.seen.layout.prims)
                shot.clock.lap("sums")
            arrays |= _fetched(shot.device, sums.finish())
        return arrays

    def _motion(self, shot: Shot, prepared: Prepared, center: sampling.Sample) -> Motion | None:
        """Where everything is in the neighbouring frames, if somebody asks."""
        if not MOTION & set(shot.aovs):
            return None
        motion = Motion.between(shot.moments, center.time, prepared.screen)
        shot.clock.lap("motion")
        return motion


def depends_on_time(settings: RenderSettings, camera: CameraSpec, aovs: tuple[str, ...]) -> bool:
    """Whether a picture shows other times than its own."""
    begin, end = camera.shutter
    blurred = settings.samples > 1 and settings.motion_blur and (begin != 0 or end != 0)
    return blurred or bool(MOTION & set(aovs))


def blend_space_of(scene: RenderScene, settings: RenderSettings) -> str:
    """The space in which splats are blended: the captures' own where they agree, or linear."""
    if settings.blend_space == "linear":
        return settings.working_space
    spaces = {field.spec.color_space for field in scene.visible_fields()}
    return spaces.pop() if len(spaces) == 1 else DISPLAY_SPACE


def _output(device: Device, settings: RenderSettings, blend_space: str, view: View) -> Output:
    return Output(device, settings, blend_space, view.camera.exposure)


def _fetched(device: Device, arrays: dict[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """AOVs on the host."""
    found = {name: device.fetch(array) for name, array in arrays.items()}
    if "albedo" in found:
        found["albedo"] = found["albedo"][..., :3]
    return found
