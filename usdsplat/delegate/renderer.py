"""From a render scene and a view to bands of pixels: the order of the kernels, and nothing else.

project, radiance        once per field, for all its instances
sort, gather             once, over all that is visible: one order for the whole view
bins, blend              once per band of the data window
median, resolve          the same, when depth or ids are asked for
recolor                  the same, when the output space is not the blend space
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import UsageError
from usdsplat.delegate.band import Band
from usdsplat.delegate.draw_list import DrawList, Group
from usdsplat.delegate.render_scene import RenderScene
from usdsplat.delegate.render_settings import RenderSettings
from usdsplat.delegate.scratch import Scratch
from usdsplat.delegate.screen import Screen
from usdsplat.delegate.specs import View
from usdsplat.images.color import conversion, is_identity
from usdsplat.kernels import bins, blend, median, project, radiance, recolor, sort
from usdsplat.kernels.device import CpuDevice

AOVS = ("color", "depth", "primId", "instanceId", "elementId")
"""What can be rendered, in Hydra's words. `color` is premultiplied RGBA in the output space;
`depth` the planar camera depth at which half of the pixel's own coverage is passed, +inf where
nothing is; the ids are those of the splat that passes it, -1 where nothing is: `primId` counts the
drawn prims in the order of their paths, `instanceId` is the number within a point instancer and
`elementId` the splat's row in its prim's arrays."""

BAND_PIXELS = 1 << 21
"""[pixel] of a band: a 1920x1080 picture is one band, a 3840x2160 one four."""
DISPLAY_SPACE, SCENE_SPACE = "srgb_rec709_scene", "lin_rec709_scene"


@dataclass(slots=True)
class FrameStats:
    """What one picture took."""

    splats: int = 0
    """Splats that were drawn, instances counted each."""
    visible: int = 0
    """Splats that may touch the data window."""
    pairs: int = 0
    """Splats times the tiles that each touches."""
    rows: int = 0
    """Rows of 16 pixels that were blended."""
    wall_ms: dict[str, float] = field(default_factory=dict)
    cpu_ms: dict[str, float] = field(default_factory=dict)
    """Milliseconds by stage."""


class _Clock:
    """Adds up what each stage takes."""

    def __init__(self, stats: FrameStats) -> None:
        self._stats = stats
        self.resume()

    def resume(self) -> None:
        """Book nothing for the time since the last lap: the caller had its turn."""
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap to `stage`."""
        wall, cpu = time.perf_counter(), time.process_time()
        for book, spent in (
            (self._stats.wall_ms, wall - self._wall),
            (self._stats.cpu_ms, cpu - self._cpu),
        ):
            book[stage] = book.get(stage, 0.0) + 1e3 * spent
        self._wall, self._cpu = wall, cpu


@dataclass(frozen=True, slots=True, eq=False)
class _Visible:
    """What the view sees, nearest first."""

    records: F32
    order: npt.NDArray[np.int32]
    sources: npt.NDArray[np.int32]
    layout: DrawList


class Renderer:
    """Draws views of render scenes on one device. It keeps buffers between pictures, not scenes."""

    def __init__(self, device: CpuDevice) -> None:
        self._device = device
        self._idle: list[Scratch] = []
        self._closed = False
        self.stats = FrameStats()
        """Of the last picture."""

    def close(self) -> None:
        """Release the buffers; those of a picture that is being drawn go with its last band."""
        self._closed = True
        self._idle.clear()

    def render(
        self, scene: RenderScene, view: View, settings: RenderSettings, aovs: tuple[str, ...]
    ) -> Iterator[Band]:
        """Draw the data window of `view`, band after band from the top.

        Args:
            settings: With nothing left on auto but `rasterize_mode`.
            aovs: Which of AOVS.

        Raises:
            UsageError: If an AOV is unknown or the view has no area.
        """
        for name in aovs:
            if name not in AOVS:
                raise UsageError("AOV", repr(name), f"one of {', '.join(AOVS)}")
        screen = Screen.of(view)
        return self._bands(scene, screen, settings, aovs)

    def _bands(
        self, scene: RenderScene, screen: Screen, settings: RenderSettings, aovs: tuple[str, ...]
    ) -> Iterator[Band]:
        scratch = self._idle.pop() if self._idle else Scratch(self._device.empty)
        try:
            stats = FrameStats()
            clock = _Clock(stats)
            blend_space = _blend_space(scene)
            seen = self._see(scene, screen, settings, blend_space, scratch, stats, clock)
            target = SCENE_SPACE if settings.color_mode == "scene" else DISPLAY_SPACE
            output = conversion(blend_space, target)
            for y0, y1 in screen.bands(BAND_PIXELS):
                arrays = self._draw(seen, screen, (y0, y1), aovs, scratch, stats, clock)
                if "color" in aovs and not is_identity(output):
                    self._device.run(recolor.recolor, arrays["color"], output)
                    clock.lap("recolor")
                self.stats = stats
                yield Band(y0, y1, {name: arrays[name] for name in aovs})
                clock.resume()
        finally:
            if not self._closed:
                self._idle.append(scratch)

    # --- once per view ---------------------------------------------------------------------

    def _see(
        self,
        scene: RenderScene,
        screen: Screen,
        settings: RenderSettings,
        blend_space: str,
        scratch: Scratch,
        stats: FrameStats,
        clock: _Clock,
    ) -> _Visible:
        """Project, colour and sort all splats of the view."""
        layout = scene.draw_list()
        slots = layout.slots
        if slots > np.iinfo(np.int32).max:
            raise UsageError("scene", f"{slots} splats in one view", "less than 2**31")
        out = (
            scratch.get("records", (slots, project.RECORD), np.float32),
            scratch.get("keys", (slots,), np.float32),
            scratch.get("sources", (slots,), np.int32),
        )
        found = scratch.get("found", layout.block_starts.shape, np.int32)
        ends = np.cumsum([group.all_blocks for group in layout.groups])
        parts = np.split(found, ends[:-1])
        stats.splats = layout.splats
        for group, part in zip(layout.groups, parts, strict=bool(layout.groups)):
            self._project(group, screen, settings, out, part)
        clock.lap("project")
        for group, part in zip(layout.groups, parts, strict=bool(layout.groups)):
            self._radiance(group, screen, settings, blend_space, out, part)
        clock.lap("radiance")
        run, threads = self._device.run, self._device.threads
        visible = scratch.get("visible", (slots,), np.int32)
        total = run(sort.visible_slots, found, layout.block_starts, len(found), visible)
        work = (
            scratch.get("sort keys", (2, total), np.uint32),
            scratch.get("sort slots", (2, total), np.int32),
        )
        histogram = scratch.get("histogram", (4 * threads, sort.DIGITS), np.int64)
        half = run(sort.depth_order, visible, total, out[1], 4 * threads, work, histogram)
        order = work[1][half]
        records = scratch.get("ordered", (total, project.RECORD), np.float32)
        run(sort.gather, order, out[0], records)
        clock.lap("sort")
        stats.visible = total
        return _Visible(records, order, out[2], layout)

    def _project(
        self, group: Group, screen: Screen, settings: RenderSettings, out: Any, found: Any
    ) -> None:
        spec, upload = group.field.spec, self._device.upload
        mode = settings.rasterize_mode
        antialiased = (spec.rasterize_mode if mode == "auto" else mode) == "antialiased"
        camera = screen.record(
            tangential=spec.projection_mode == "tangential",
            by_distance=settings.sorting == "cameraDistance",
            antialiased=antialiased,
        )
        matrices = screen.world_to_camera[:3] @ group.transforms
        cloud = spec.cloud
        self._device.run(
            project.project, camera, matrices, upload(cloud.positions), upload(cloud.rotations),
            upload(cloud.scales), upload(cloud.opacities), group.block, group.slot, out, found,
        )  # fmt: skip

    def _radiance(
        self,
        group: Group,
        screen: Screen,
        settings: RenderSettings,
        blend_space: str,
        out: Any,
        found: Any,
    ) -> None:
        spec, upload = group.field.spec, self._device.upload
        sights = _sights(group, screen)
        numbers = conversion(spec.color_space, blend_space)
        degree = min(settings.sh_degree, spec.cloud.sh_degree)
        self._device.run(
            radiance.radiance, sights, upload(spec.cloud.positions), upload(spec.cloud.sh), degree,
            numbers, not is_identity(numbers), group.block, group.slot, out, found,
        )  # fmt: skip

    # --- once per band ---------------------------------------------------------------------

    def _draw(
        self,
        seen: _Visible,
        screen: Screen,
        rows: tuple[int, int],
        aovs: tuple[str, ...],
        scratch: Scratch,
        stats: FrameStats,
        clock: _Clock,
    ) -> dict[str, npt.NDArray[Any]]:
        """Blend one band; returns its AOVs."""
        run = self._device.run
        x0, _, x1, _ = screen.window
        grid = bins.grid_of(x0, rows[0], x1, rows[1])
        tiles = int(grid["columns"][0] * grid["rows"][0])
        chunks = 4 * self._device.threads
        counts = scratch.get("counts", (chunks, tiles + 1), np.int32)
        starts = scratch.get("starts", (tiles + 1,), np.int64)
        run(bins.count_tiles, seen.records, grid, chunks, counts)
        pairs = run(bins.offsets, counts, starts)
        if pairs > np.iinfo(np.int32).max:
            raise UsageError("band", f"{pairs} pairs of splat and tile", "less than 2**31")
        lists = scratch.get("lists", (pairs,), np.int32)
        run(bins.fill_tiles, seen.records, grid, chunks, counts, lists)
        clock.lap("bins")
        shape = (rows[1] - rows[0], x1 - x0)
        color = scratch.get("color", (*shape, 4), np.float32)
        work = scratch.get("work", (tiles,), np.int64)
        flat = color.reshape(len(color), -1)
        run(blend.blend, seen.records, starts, lists, grid, flat, work)
        clock.lap("blend")
        stats.pairs += int(pairs)
        stats.rows += int(work.sum())
        arrays: dict[str, npt.NDArray[Any]] = {"color": color}
        if set(aovs) - {"color"}:
            ranks = scratch.get("ranks", shape, np.int32)
            depth = scratch.get("depth", shape, np.float32)
            ids = scratch.get("ids", (3, *shape), np.int32)
            run(median.median, seen.records, starts, lists, grid, color, ranks)
            run(
                median.resolve, ranks, seen.records, seen.order, seen.sources,
                seen.layout.first_slots, seen.layout.labels, depth, ids,
            )  # fmt: skip
            arrays |= {"depth": depth, "primId": ids[0], "instanceId": ids[1], "elementId": ids[2]}
            clock.lap("median")
        return arrays


def _blend_space(scene: RenderScene) -> str:
    """The space in which the visible captures are blended: their own where they agree."""
    spaces = {field.spec.color_space for field in scene.visible_fields()}
    return spaces.pop() if len(spaces) == 1 else DISPLAY_SPACE


def _sights(group: Group, screen: Screen) -> F64:
    """Affine maps from a splat's position to its direction of sight in the field's own space.

    A = Q P with Q orthogonal, reflections included: directions go back by Qᵀ, so Qᵀ A = P takes the
    positions. Of an orthographic camera the direction is the same everywhere. Shape (m, 3, 4).
    """
    back = group.turns.transpose(0, 2, 1)
    sights = np.zeros((len(back), 3, 4))
    if screen.orthographic:
        sights[:, :, 3] = back @ screen.forward
    else:
        sights[:, :, :3] = group.stretches
        sights[:, :, 3:] = back @ (group.transforms[:, :3, 3:] - screen.eye[:, None])
    return sights
