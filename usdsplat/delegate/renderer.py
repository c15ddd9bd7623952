"""From a render scene and a view to bands of pixels: the order of the stages, and nothing else.

surfaces, look           once per sample of a view, see `Surfaces` and `Look`
layer                    once per band: lists of tiles, then whatever is asked for
output, over             splats and surfaces in the picture's space, one over the other
sums                     the average over all samples

A sample is a sharp picture at one time through one point of the lens. Colours, albedo and mattes
are averaged; all else is read from the sample in the middle and never mixed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import UsageError
from usdsplat.delegate import sampling
from usdsplat.delegate.band import Band
from usdsplat.delegate.frame_stats import Clock, FrameStats
from usdsplat.delegate.holdout import HoldoutRows, hold_back
from usdsplat.delegate.layer import Behind, DeepSamples, Layer
from usdsplat.delegate.motion import Motion
from usdsplat.delegate.output import DISPLAY_SPACE, Output
from usdsplat.delegate.render_scene import RenderScene
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.screen import Screen
from usdsplat.delegate.specs import View
from usdsplat.delegate.sums import Sums
from usdsplat.delegate.surface_cache import SurfaceCache
from usdsplat.delegate.surfaces import SurfaceBand, Surfaces
from usdsplat.delegate.visible import Look, Visible, Wanted
from usdsplat.kernels import feature, position, surface
from usdsplat.kernels.device import CpuDevice

AVERAGED = ("color", "albedo", "cryptoObject")
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
ORDERED = ("zDepth", "rayHitDistance")
"""Orders in which a deep picture's samples can be kept: those of planar depths."""

Moment = tuple[RenderScene, View]
Moments = Callable[[float], Moment]
"""The scene and the view at a time [time code] relative to the frame; 0 goes back to it."""
Holdout = Callable[[int, int, int, int], HoldoutRows]
"""What an external holdout has in the pixels x0, y0, x1, y1."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Shot:
    """One picture that is being drawn: what all its bands and samples share."""

    moments: Moments
    settings: RenderSettings
    aovs: tuple[str, ...]
    blend_space: str
    output: Output
    holdout: Holdout | None
    scratch: Scratch
    stats: FrameStats
    clock: Clock


@dataclass(frozen=True, slots=True, eq=False)
class _Prepared:
    """One sample of a view before any pixel."""

    screen: Screen
    seen: Visible
    surfaces: Surfaces | None


class Renderer:
    """Draws views of render scenes on one device. It keeps buffers between pictures, not scenes."""

    def __init__(self, device: CpuDevice) -> None:
        self._device = device
        self._idle: list[Scratch] = []
        self._closed = False
        self._surface_cache = SurfaceCache()
        self.stats = FrameStats()
        """Of the last picture."""

    def close(self) -> None:
        """Release the buffers; those of a picture that is being drawn go with its last band."""
        self._closed = True
        self._idle.clear()
        self._surface_cache = SurfaceCache()

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
        blend_space = _blend_space(scene, settings)
        output = Output(self._device, settings, blend_space, view.camera.exposure)

        def still(_: float) -> Moment:
            return scene, view

        def bands(scratch: Scratch) -> Iterator[Band]:
            stats = FrameStats()
            shot = _Shot(
                moments=moments or still,
                settings=settings,
                aovs=aovs,
                blend_space=blend_space,
                output=output,
                holdout=holdout,
                scratch=scratch,
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
        output = Output(self._device, settings, blend_space, view.camera.exposure)

        def bands(scratch: Scratch) -> Iterator[tuple[int, int, DeepSamples]]:
            stats = FrameStats()
            shot = _Shot(
                moments=lambda _: (scene, view),
                settings=settings,
                aovs=(),
                blend_space=blend_space,
                output=output,
                holdout=holdout,
                scratch=scratch,
                stats=stats,
                clock=Clock(stats),
            )
            prepared = self._prepare(shot, sampling.Sample(), screen.window)
            for y0, y1 in screen.bands(band_pixels):
                layer, _, drawn = self._layer(shot, prepared, y0, y1)
                samples = layer.deep(settings.deep_error)
                samples.color[:, :3] *= np.float32(view.camera.exposure)
                if drawn is not None:
                    samples = samples.with_surfaces(
                        drawn.depth, drawn.covered == surface.DRAWN, output.surfaces(drawn.color)
                    )
                shot.clock.lap("deep")
                self.stats = stats
                yield y0, y1, samples
                shot.clock.resume()

        return self._borrowing(bands)

    # --- private ---------------------------------------------------------------------------

    def _borrowing(self, bands: Callable[[Scratch], Iterator[Any]]) -> Iterator[Any]:
        """Run a generator with buffers of its own, which others take over at its end."""
        scratch = self._idle.pop() if self._idle else Scratch(self._device.empty)
        try:
            yield from bands(scratch)
        finally:
            if not self._closed:
                self._idle.append(scratch)

    def _rows(
        self, shot: _Shot, screen: Screen, view: View, band_pixels: int
    ) -> Iterator[tuple[int, int, dict[str, npt.NDArray[Any]]]]:
        """Bands of a picture, whatever the number of its samples."""
        plan = sampling.samples(shot.settings, view.camera)
        center = sampling.center(shot.settings, view.camera)
        x0, _, x1, _ = screen.window
        if len(plan) == 1:
            prepared = self._prepare(shot, center, screen.window)
            motion = self._motion(shot, prepared, center)
            for y0, y1 in screen.bands(band_pixels):
                yield y0, y1, self._draw(shot, prepared, motion, y0, y1, shot.aovs)
            return
        averaged = tuple(name for name in shot.aovs if name in AVERAGED)
        read = tuple(name for name in shot.aovs if name not in AVERAGED)
        for y0, y1 in screen.bands(band_pixels):
            window = x0, y0, x1, y1
            arrays: dict[str, npt.NDArray[Any]] = {}
            if read:
                prepared = self._prepare(shot, center, window)
                motion = self._motion(shot, prepared, center)
                arrays |= self._draw(shot, prepared, motion, y0, y1, read)
            if averaged:
                sums = Sums(self._device, shot.scratch, (y1 - y0, x1 - x0), averaged)
                for sample in plan:
                    prepared = self._prepare(shot, sample, window)
                    sums.add(self._draw(shot, prepared, None, y0, y1, averaged, raw=True))
                    shot.clock.lap("sums")
                arrays |= sums.finish(prepared.seen.layout.prims)
            shot.moments(0.0)
            yield y0, y1, arrays

    def _motion(self, shot: _Shot, prepared: _Prepared, center: sampling.Sample) -> Motion | None:
        """Where everything is in the neighbouring frames, if somebody asks."""
        if not {"motionForward", "motionBackward"} & set(shot.aovs):
            return None
        motion = Motion.between(shot.moments, center.time, prepared.screen)
        shot.clock.lap("motion")
        return motion

    def _prepare(
        self, shot: _Shot, sample: sampling.Sample, window: tuple[int, int, int, int]
    ) -> _Prepared:
        """What comes before any pixel of a sample, as far as it is seen in `window`."""
        scene, view = shot.moments(sample.time)
        screen = replace(Screen.of(view), window=window).through(
            sample.lens, view.camera.focus_distance, sample.offset
        )
        surfaces = Surfaces.of(self._device, scene, screen, view.matte, cache=self._surface_cache)
        shot.clock.lap("surfaces")
        by_ray = shot.settings.sorting == "rayHitDistance"
        wanted = Wanted(
            peaks=by_ray or surfaces is not None or shot.holdout is not None,
            features=bool({"Neye", "albedo", "depthExpected"} & set(shot.aovs)),
            labels="cryptoObject" in shot.aovs,
        )
        look = Look(self._device, shot.scratch, scene, screen, shot.settings, shot.blend_space)
        return _Prepared(screen, look.take(wanted, view.matte, shot.stats, shot.clock), surfaces)

    def _layer(
        self, shot: _Shot, prepared: _Prepared, y0: int, y1: int
    ) -> tuple[Layer, Behind, SurfaceBand | None]:
        """The splats of a band, and what is behind them."""
        x0, _, x1, _ = prepared.screen.window
        drawn = None
        behind = Behind()
        if prepared.surfaces is not None:
            drawn = prepared.surfaces.draw(y0, y1, shot.scratch)
            behind = Behind(drawn.depth, drawn.covered)
            shot.clock.lap("surfaces")
        if shot.holdout is not None:
            behind = hold_back(self._device, behind, shot.holdout(x0, y0, x1, y1))
        layer = Layer(
            self._device,
            shot.scratch,
            prepared.seen,
            (x0, y0, x1, y1),
            by_ray=shot.settings.sorting == "rayHitDistance",
            behind=behind,
            stats=shot.stats,
        )
        shot.clock.lap("bins")
        return layer, behind, drawn

    def _draw(
        self,
        shot: _Shot,
        prepared: _Prepared,
        motion: Motion | None,
        y0: int,
        y1: int,
        aovs: tuple[str, ...],
        *,
        raw: bool = False,
    ) -> dict[str, npt.NDArray[Any]]:
        """One band of one sample; `raw` mattes are (ids, weights), to be summed."""
        layer, behind, drawn = self._layer(shot, prepared, y0, y1)
        color, through = layer.color()
        shot.clock.lap("blend")
        left = None if drawn is None else self._left(shot, color, through, behind)
        wanted = set(aovs)
        arrays: dict[str, npt.NDArray[Any]] = {}
        if wanted - set(AVERAGED) - {"Neye", "depthExpected", "depthFront"}:
            arrays |= self._nearest(shot, layer, behind, drawn, "median", 0.5)
            arrays |= self._places(shot, prepared, motion, arrays, drawn, y0, wanted)
        if "depthFront" in wanted:
            front = self._nearest(shot, layer, behind, drawn, "front", 0.0)
            arrays["depthFront"] = front["depth"]
        if wanted & {"Neye", "depthExpected", "albedo"}:
            arrays |= self._features(shot, layer, left, drawn, wanted)
        if "cryptoObject" in wanted:
            arrays["cryptoObject"] = self._mattes(shot, prepared, layer, left, drawn, raw=raw)
        if "color" in wanted:
            arrays["color"] = self._finish(
                shot, color, left, None if drawn is None else drawn.color
            )
        return arrays

    def _left(self, shot: _Shot, color: F32, through: F32 | None, behind: Behind) -> F32:
        """What the splats let through of the surfaces behind them."""
        left = shot.scratch.get("left", color.shape[:2], np.float32)
        nothing = np.empty((0, 0), np.float32)
        self._device.run(
            surface.show_through, color, nothing if through is None else through, behind.covered,
            behind.stops, behind.holdout, left,
        )  # fmt: skip
        return left

    def _finish(self, shot: _Shot, layer: F32, left: F32 | None, behind: F32 | None) -> F32:
        """A layer in the picture's space, over what it lets through."""
        image = shot.output.splats(layer)
        if left is not None and behind is not None:
            self._device.run(surface.over, image, left, shot.output.surfaces(behind))
        shot.clock.lap("output")
        return image

    def _nearest(
        self,
        shot: _Shot,
        layer: Layer,
        behind: Behind,
        drawn: SurfaceBand | None,
        name: str,
        part: float,
    ) -> dict[str, npt.NDArray[Any]]:
        """Depth and identity of what passes a part of the coverage, surfaces included."""
        depth, ids = layer.median(name, part)
        if drawn is not None:
            run = self._device.run
            run(surface.nearest, depth, ids, behind.stops, behind.covered, drawn.ids)
        shot.clock.lap("median")
        return {
            "depth": depth,
            "primId": ids[0],
            "instanceId": ids[1],
            "elementId": ids[2],
            "row": ids[3],
        }

    def _places(
        self,
        shot: _Shot,
        prepared: _Prepared,
        motion: Motion | None,
        median: dict[str, npt.NDArray[Any]],
        drawn: SurfaceBand | None,
        y0: int,
        wanted: set[str],
    ) -> dict[str, npt.NDArray[Any]]:
        """Positions and motion of the median surface."""
        arrays: dict[str, npt.NDArray[Any]] = {}
        depth, x0 = median["depth"], prepared.screen.window[0]
        if "P" in wanted:
            arrays["P"] = shot.scratch.get("P", (*depth.shape, 3), np.float32)
            self._device.run(
                position.positions, prepared.screen.view_record(),
                np.ascontiguousarray(np.linalg.inv(prepared.screen.world_to_camera)[:3]), depth,
                x0, y0, arrays["P"],
            )  # fmt: skip
        if motion is not None:
            arrays |= motion.draw(self._device, shot.scratch, median, drawn, x0, y0, wanted)
        shot.clock.lap("places")
        return arrays

    def _features(
        self,
        shot: _Shot,
        layer: Layer,
        left: F32 | None,
        drawn: SurfaceBand | None,
        wanted: set[str],
    ) -> dict[str, npt.NDArray[Any]]:
        """What is averaged over all contributions of a pixel."""
        arrays: dict[str, npt.NDArray[Any]] = {}
        get, run = shot.scratch.get, self._device.run
        if "albedo" in wanted:
            image = layer.paint("albedo", feature.ALBEDO)
            image = self._finish(shot, image, left, None if drawn is None else drawn.albedo)
            arrays["albedo"] = image[..., :3]
        if "Neye" in wanted:
            sums = layer.paint("normals", feature.NORMAL)
            arrays["Neye"] = get("Neye", (*sums.shape[:2], 3), np.float32)
            none = np.empty((0, 0, 3), np.float32)
            run(
                feature.unit, sums, none if drawn is None else drawn.normal,
                none[..., 0] if left is None else left, arrays["Neye"],
            )  # fmt: skip
        if "depthExpected" in wanted:
            sums = layer.paint("expected", feature.EXPECTED)
            if left is not None and drawn is not None:
                behind = np.zeros((*left.shape, 3), np.float32)
                np.copyto(behind[..., 0], drawn.depth, where=left > 0)
                run(surface.over, sums, left, behind)
            expected = get("Zexp", sums.shape[:2], np.float32)
            expected[:] = np.inf
            np.divide(sums[..., 0], sums[..., 3], out=expected, where=sums[..., 3] > 0)
            arrays["depthExpected"] = expected
        shot.clock.lap("features")
        return arrays

    def _mattes(
        self,
        shot: _Shot,
        prepared: _Prepared,
        layer: Layer,
        left: F32 | None,
        drawn: SurfaceBand | None,
        *,
        raw: bool,
    ) -> Any:
        """How much each prim covers of each pixel."""
        found = [layer.weigh()]
        if left is not None and drawn is not None:
            prims = np.where(left > 0, drawn.ids[0], -1).astype(np.int32)
            found.append((prims[..., None], left[..., None]))
        shot.clock.lap("mattes")
        if raw:
            return found
        sums = Sums(self._device, shot.scratch, layer.shape, ("cryptoObject",))
        sums.add({"cryptoObject": found})
        return sums.finish(prepared.seen.layout.prims)["cryptoObject"]


def _blend_space(scene: RenderScene, settings: RenderSettings) -> str:
    """The space in which splats are blended: the captures' own where they agree, or linear."""
    if settings.blend_space == "linear":
        return settings.working_space
    spaces = {field.spec.color_space for field in scene.visible_fields()}
    return spaces.pop() if len(spaces) == 1 else DISPLAY_SPACE
