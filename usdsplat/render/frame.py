"""Render a frame: from a scene and a view to bands of pixels.

    prepare       of each sample: place surfaces, project, shade, find ray hits, find features, sort
    draw_band     of each band: rasterize surfaces, bin splats by tile, resolve the AOVs
    average_band  over the samples of a band

A sample is a sharp picture at one time through one point of the lens. Where coarse levels of splat
trees are seen, it is repeated with other points in the pixel for them, see `lod.nodes`. A picture
of one sample is prepared once, for all of its bands. Each of many samples is prepared again for
each band, so that memory does not grow with their number.

Tiles are rasterized where AOVs are resolved, in `aov_resolver`. Colour, albedo, AOVs of light and
mattes are averaged over all samples. Every other AOV is read from one more sample, in the center of
shutter, lens and pixel, and is never mixed. A device may draw a picture that needs colour alone in
one step, see `Rasterizer.draw_color`. `render_deep` draws deep pictures of one sample, and
`deep_merging` those of many.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.images.aovs import is_light
from usdsplat.images.cryptomatte import LAYERS
from usdsplat.kernels import surface
from usdsplat.render import sampling
from usdsplat.render.accumulator import LayerAverage, SampleAccumulator
from usdsplat.render.aov_resolver import (
    SUMMED,
    SURFACE,
    AovResolver,
    SplatLayers,
    composited,
    composited_parts,
    is_averaged,
)
from usdsplat.render.band import Band
from usdsplat.render.deep_samples import DeepSamples
from usdsplat.render.display import displayed
from usdsplat.render.frame_context import FrameContext, FrameSample
from usdsplat.render.group_gains import NO_GAINS
from usdsplat.render.lights.lighting import lighting_of
from usdsplat.render.lights.needs import LightRequest, with_catchers
from usdsplat.render.lights.paints import LightPaints
from usdsplat.render.lod.nodes import samples_of
from usdsplat.render.motion import Motion
from usdsplat.render.occluders import Occluders, with_holdout
from usdsplat.render.projected_splats import ProjectedSplats
from usdsplat.render.projector import Projector
from usdsplat.render.rasterizer import WholeImage
from usdsplat.render.screen import Screen
from usdsplat.render.specs import CameraSpec, View
from usdsplat.render.surfaces import SurfaceBand, Surfaces
from usdsplat.render.tile_lists import TileLists

MOTION = {"motionForward", "motionBackward"}
"""AOVs that need the neighbouring frames."""
DEEP_PIXELS = 1 << 17
"""Pixels of a strip. Deep samples are drawn in strips, as a pixel can have any number of them."""


def render_frame(
    frame: FrameContext, camera: CameraSpec, screen: Screen, band_pixels: int
) -> Iterator[Band]:
    """Draw a picture, band by band from the top."""
    samples = sampling.samples(frame.settings, camera)
    plan = samples_of(frame.settings, samples, frame.nodes, frame.settings.lod_samples)
    if len(plan) == 1 and len(plan[0]) == 1:
        only = plan[0][0]
        sample = prepare(frame, only, screen.window, frame.aovs)
        motion = find_motion(frame, sample, only)
        for y0, y1 in screen.bands(band_pixels):
            arrays = draw_band(frame, sample, (y0, y1), frame.aovs, motion)
            yield fetched(frame, (y0, y1), arrays)
        return
    center = sampling.center(frame.settings, camera)
    for y0, y1 in screen.bands(band_pixels):
        try:
            band = average_band(frame, plan, center, screen, (y0, y1))
        finally:  # samples move the scene in time; return to the frame, also after an error
            frame.sampler(0.0)
        yield band


def average_band(
    frame: FrameContext,
    plan: tuple[tuple[sampling.Sample, ...], ...],
    center: sampling.Sample,
    screen: Screen,
    rows: tuple[int, int],
) -> Band:
    """Return one band of many samples.

    Sampling moves the scene in time. The caller returns it with `frame.sampler(0.0)`.
    """
    (x0, _, x1, _), (y0, y1) = screen.window, rows
    window = x0, y0, x1, y1
    averaged = tuple(name for name in frame.aovs if is_averaged(name))
    from_center = tuple(name for name in frame.aovs if not is_averaged(name))
    band = Band(y0, y1, {})
    if from_center:
        sample = prepare(frame, center, window, from_center)
        motion = find_motion(frame, sample, center)
        band = fetched(frame, rows, draw_band(frame, sample, rows, from_center, motion))
    if averaged:
        sums = SampleAccumulator(frame, (y1 - y0, x1 - x0), averaged)
        for each in plan:
            if len(each) > 1:
                add_repeated(frame, each, window, averaged, sums)
                continue
            sample = prepare(frame, each[0], window, averaged)
            drawn = draw_band(frame, sample, rows, averaged, None, raw=True)
            sums.add(drawn, sample.groups)
            frame.clock.lap("accumulate")
        mean = fetched(frame, rows, sums.finish())
        band = Band(y0, y1, band.arrays | mean.arrays, band.lasting | mean.lasting)
    return band


def add_repeated(
    frame: FrameContext,
    repeated: tuple[sampling.Sample, ...],
    window: tuple[int, int, int, int],
    aovs: tuple[str, ...],
    sums: SampleAccumulator,
) -> None:
    """Add the mean of samples that differ only in coarse levels of splat trees.

    Args:
        window: The pixels of the band.
        aovs: Averaged AOVs.
        sums: The accumulator of the picture.
    """
    (x0, y0, x1, y1), behind, means = window, None, None
    mean = LayerAverage(frame, (y1 - y0, x1 - x0))
    for each in repeated:
        sample = prepare(frame, each, window, aovs)
        if isinstance(sample.splats, WholeImage):
            mean.add(SplatLayers(color=sample.splats.rows(y0, y1), albedo=None, left=None))
            continue
        tiles, occluders, behind = bin_band(frame, sample, (y0, y1))
        resolver = AovResolver(frame, sample, tiles, occluders, behind)
        layers, mattes = resolver.layers(aovs)
        if means is None:  # of one of them: they differ in far splats alone
            means = resolver.light_means(set(aovs), layers.left)
        mean.add(layers)
        sums.add_mattes(mattes, sample.groups)
        frame.stats.blocks += tiles.blocks
        frame.clock.lap("accumulate")
    found = mean.finish()
    color = None if behind is None else behind.color
    arrays = means or {}
    if found.lights is not None:
        parts = LightRequest.of(aovs).parts
        arrays |= composited_parts(frame, parts, found.lights, found.left, behind)
    arrays["color"] = composited(frame, found.color, found.left, color)
    if found.albedo is not None:
        under = None if behind is None else behind.albedo
        arrays["albedo"] = composited(frame, found.albedo, found.left, under, counts=False)
    sums.add_images(arrays)
    frame.clock.lap("accumulate")


def render_deep(
    frame: FrameContext, camera: CameraSpec, screen: Screen, band_pixels: int
) -> Iterator[tuple[int, int, DeepSamples]]:
    """Return all contributions to each pixel, in strips of a band: (y0, y1, samples).

    Samples have those AOVs of `deep_samples.DEEP_IDS` as ids that `frame.aovs` contains.
    """
    sample = prepare(frame, sampling.Sample(), screen.window, ())
    x0, _, x1, _ = screen.window
    error = frame.settings.deep_error
    for top, bottom in screen.bands(band_pixels):
        tiles, _, surfaces = bin_band(frame, sample, (top, bottom))
        behind = None if surfaces is None else fetched_surfaces(frame, surfaces)
        for y0, y1 in replace(screen, window=(x0, top, x1, bottom)).bands(DEEP_PIXELS):
            rows = slice(y0 - top, y1 - top)
            some = None if behind is None else tuple(each[..., rows, :] for each in behind)
            yield y0, y1, deep_samples(frame, camera, tiles.rows_between(y0, y1), some, error)


def fetched_surfaces(frame: FrameContext, surfaces: SurfaceBand) -> tuple[npt.NDArray[Any], ...]:
    """Return depths, visibility, linear colours as (3, h, w), and ids of surfaces, on the host."""
    fetch = frame.device.fetch
    return (
        fetch(surfaces.depth),
        fetch(surfaces.covered) == surface.DRAWN,
        np.moveaxis(fetch(frame.output.surfaces(surfaces.color)), 2, 0),
        fetch(surfaces.ids),
    )


def deep_samples(
    frame: FrameContext,
    camera: CameraSpec,
    tiles: TileLists,
    behind: tuple[npt.NDArray[Any], ...] | None,
    error: float,
) -> DeepSamples:
    """Return the deep samples of some rows, surfaces included.

    Args:
        behind: Result of `fetched_surfaces` for these rows; None without surfaces.
        error: See `TileLists.deep`.
    """
    samples = tiles.deep(error, frame.aovs)
    if camera.exposure != 1.0:
        samples.color[:, :3] *= np.float32(camera.exposure)
    if behind is not None:
        depth, is_drawn, color, ids = behind
        samples = samples.with_surfaces(depth, is_drawn, np.moveaxis(color, 0, 2), ids)
    frame.clock.lap("deep")
    return samples


def prepare(
    frame: FrameContext,
    sample: sampling.Sample,
    window: tuple[int, int, int, int],
    aovs: tuple[str, ...],
) -> FrameSample:
    """Take the steps of a sample that precede the drawing of bands.

    Args:
        window: Pixels x0, y0, x1, y1 that will be drawn, end exclusive.
        aovs: The AOVs that will be drawn.
    """
    scene, view = frame.sampler(sample.time)
    view = with_catchers(scene, view)
    screen = replace(Screen.of(view), window=window).through(
        sample.lens, view.camera.focus_distance, sample.offset
    )
    surfaces = Surfaces.of(frame.device, scene, screen, view.matte, cache=frame.surface_cache)
    frame.clock.lap("surfaces")
    layout = frame.layout(scene, sample.fade)
    frame.clock.lap("lay out")
    inner = _inner_screen(view, window, sample) if frame.nodes else None
    lighting = lighting_of(
        frame.rasterizer, frame.buffers, frame.settings, scene, view, layout, aovs,
        frame.patience,
    )  # fmt: skip
    gains = NO_GAINS if lighting is None else lighting.gains
    if lighting is not None:
        frame.stats.light_steps += lighting.steps
        frame.stats.lacks_light |= lighting.is_behind
        frame.clock.lap("light splats")
    projector = Projector(
        frame.device, frame.buffers, layout, screen, frame.settings, frame.blend_space, inner,
        gains,
    )  # fmt: skip
    occludes = surfaces is not None or frame.holdout is not None
    if set(aovs) == {"color"} and not occludes and not gains:
        # None unless this device fuses the steps for such a picture
        whole = frame.rasterizer.draw_color(projector, view.matte, frame.buffers, frame.stats)
        if whole is not None:
            frame.clock.lap("draw color")
            return FrameSample(screen, whole, None, {})
    splats = _projected(frame, projector, view.matte, aovs, occludes=occludes)
    mode = frame.settings.display_mode
    if mode != "splats":
        splats = displayed(
            frame.device, frame.buffers.display, splats, mode, view.framing.pixel_scale
        )
        if mode == "ellipses":  # each splat is drawn twice: the ellipse and its outline
            frame.stats.visible = splats.order.shape[0] // 2
        frame.clock.lap("display")
    paints, shadows = None, None
    if LightRequest.of(aovs).any:
        paints = LightPaints(
            device=frame.device, buffers=frame.buffers.splats, projector=projector,
            order=splats.order, lighting=lighting, blend_space=frame.blend_space,
        )  # fmt: skip
    if "shadow" in aovs and lighting is not None and paints is not None:
        caught = lighting.catch_weights
        if caught is not None:
            caught = projector.labelled(splats.order, caught)
        shadows = paints.ratios(), caught
    groups = {layer: scene.matte_groups(layer) for layer in LAYERS if layer in aovs}
    return FrameSample(screen, splats, surfaces, groups, lighting, shadows, paints)


def _inner_screen(view: View, window: tuple[int, int, int, int], sample: sampling.Sample) -> Screen:
    """Return the screen of a sample for coarse levels of splat trees."""
    screen = Screen.of(view)
    screen = replace(screen, window=window, low_pass=screen.low_pass * sample.inner_low_pass)
    return screen.through(sample.lens, view.camera.focus_distance, sample.inner_offset)


def _projected(
    frame: FrameContext,
    projector: Projector,
    matte: tuple[tuple[str, bool], ...],
    aovs: tuple[str, ...],
    *,
    occludes: bool,
) -> ProjectedSplats:
    """Project, shade and sort the splats of a sample."""
    lap, stats = frame.clock.lap, frame.stats
    projector.lay_out()
    lap("lay out")
    projector.project()
    lap("project")
    projector.shade()
    lap("shade")
    if occludes or frame.sorts_by_ray_hit:
        projector.find_ray_hits()
        lap("find ray hits")
    if SUMMED & set(aovs) or frame.settings.display_mode == "normals":
        projector.find_features(with_normals=bool(SURFACE & set(aovs)))
        lap("find features")
    splats = projector.sort(matte, labels=bool(set(LAYERS) & set(aovs)))
    lap("sort")
    stats.splats, stats.total = splats.layout.splats, splats.layout.total
    stats.visible = splats.order.shape[0]
    return splats


def draw_band(
    frame: FrameContext,
    sample: FrameSample,
    rows: tuple[int, int],
    aovs: tuple[str, ...],
    motion: Motion | None,
    *,
    raw: bool = False,
) -> dict[str, Any]:
    """Draw one band of one sample. Return arrays of the device.

    Args:
        rows: First row of the band, and the row after its last.
        motion: Motion to the neighbouring frames; None if no AOV needs it.
        raw: Whether Cryptomattes are returned as unranked (groups, weights), for the accumulator,
            which ranks the sums over all samples.
    """
    if isinstance(sample.splats, WholeImage):
        return {"color": composited(frame, sample.splats.rows(*rows), None, None)}
    tiles, occluders, surfaces = bin_band(frame, sample, rows)
    resolver = AovResolver(frame, sample, tiles, occluders, surfaces)
    arrays = resolver.resolve(aovs, motion, rows[0], raw=raw)
    frame.stats.blocks += tiles.blocks
    return arrays


def bin_band(
    frame: FrameContext, sample: FrameSample, rows: tuple[int, int]
) -> tuple[TileLists, Occluders, SurfaceBand | None]:
    """Rasterize the surfaces of a band, and bin its splats."""
    assert isinstance(sample.splats, ProjectedSplats)
    (x0, _, x1, _), (y0, y1) = sample.screen.window, rows
    surfaces, occluders = None, Occluders()
    if sample.surfaces is not None:
        surfaces = sample.surfaces.draw(y0, y1, frame.buffers)
        if sample.lighting is not None:
            surfaces = sample.lighting.lit(surfaces, sample.screen, x0, y0)
            frame.stats.lacks_light |= sample.lighting.is_behind
        occluders = Occluders(surfaces.depth, surfaces.covered)
        frame.clock.lap("surfaces")
    if frame.holdout is not None:
        held = frame.holdout(x0, y0, x1, y1)
        shape = y1 - y0, x1 - x0
        occluders = with_holdout(frame.device, frame.buffers.pixels, occluders, held, shape)
    tiles = frame.rasterizer.bin(
        sample.splats,
        (x0, y0, x1, y1),
        occluders,
        frame.buffers,
        sort_by_ray_hit=frame.sorts_by_ray_hit,
    )
    frame.stats.pairs += tiles.pairs
    frame.clock.lap("bin")
    return tiles, occluders, surfaces


def find_motion(frame: FrameContext, sample: FrameSample, center: sampling.Sample) -> Motion | None:
    """Find the motion to the neighbouring frames. Return None if no AOV needs it."""
    if not MOTION & set(frame.aovs):
        return None
    motion = Motion.between(frame.sampler, center.time, sample.screen, frame.drawn)
    frame.clock.lap("find motion")
    return motion


def fetched(frame: FrameContext, rows: tuple[int, int], arrays: dict[str, Any]) -> Band:
    """Return AOVs of the device as a band, on the host. This waits for a GPU."""
    found = {name: frame.device.fetch(array) for name, array in arrays.items()}
    frame.clock.lap("fetch")
    lasting = frozenset(name for name, array in arrays.items() if found[name] is not array)
    for name in found:  # the fourth channel of some, coverage, is not part of the AOV
        if name == "albedo" or is_light(name):
            found[name] = found[name][..., :3]
    return Band(*rows, found, lasting)
