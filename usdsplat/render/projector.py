"""The splats that a view sees: projected, shaded and sorted, once for each view."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.core.errors import UsageError
from usdsplat.images.color import conversion, is_identity
from usdsplat.kernels import blocks, feature, project, radiance, ray_hit, sort
from usdsplat.kernels.device import Device
from usdsplat.render.buffers import Memory
from usdsplat.render.crop_volumes import volumes
from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.matte import is_matte
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings

DOT_REACH = 4
"""[pixel] Beyond the data window that the dots of display mode points are kept for: the splats that
they stand for may be smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedSplats:
    """The splats that a view sees, nearest first; row k of every array is rank k.

    Arrays are the device's: fetch them before reading.
    """

    records: F32
    """Shape (n, project.RECORD)."""
    order: I32
    """Slot of each, shape (n,)."""
    sources: I32
    """Row of each slot in its field."""
    layout: DrawList
    ray_hits: F32
    """Shape (n, ray_hit.RAY_HIT), or of no size where nobody asks for ray hits."""
    features: F32
    """Shape (n, feature.FEATURES), or of no size where nobody asks."""
    keeps: F32
    """0 for what only holds out, shape (n,); of no size where nothing does."""
    labels: I32
    """Number of each one's prim, shape (n,), or of no size where nobody asks."""
    is_parallel: bool
    """Whether rays are."""
    near: float
    """Planar depth [scene unit] before which nothing is seen."""
    stamp: object
    """Token that is replaced whenever a footprint or the order changes: tile lists depend on it."""


@dataclass(slots=True, eq=False)
class _Held:
    """What the last picture left, by the first slot of each group."""

    shapes: dict[int, Any] = field(default_factory=dict)
    """All that its footprints depend on; None where that is not said."""
    radiance: dict[int, Any] = field(default_factory=dict)
    """All that its colours depend on besides."""
    order: Any = None
    stamp: object = None


class Projector:
    """The splats of a scene on their way to one view.

    `project`, `shade`, `find_ray_hits` and `find_features` fill rows of splats in the order of
    storage; `sort` gathers them in order of depth. Steps whose inputs did not change since the last
    picture are skipped.

    Args:
        blend_space: Colour space in which splats are blended.

    Raises:
        UsageError: If the scene has 2**31 splats or more.
    """

    def __init__(
        self,
        device: Device,
        buffers: FrameBuffers,
        scene: RenderScene,
        screen: Screen,
        settings: RenderSettings,
        blend_space: str,
    ) -> None:
        self._device = device
        self._buffers = buffers.splats
        self.layout = scene.draw_list(settings.splat_budget)
        self._screen = screen
        self.settings = settings
        self._blend_space = blend_space
        self._degree = settings.sh_degree
        self._is_ordered = False
        if self.layout.slots > np.iinfo(np.int32).max:
            found = f"{self.layout.slots} splats in one view"
            raise UsageError("scene", found, "less than 2**31")

    # --- the steps, in their order ---------------------------------------------------------

    def project(self) -> None:
        """Project all splats, and note which ones the view may see."""
        buffers, slots = self._buffers, self.layout.slots
        self._records = buffers.records(slots)
        self._keys = buffers.keys(slots)
        self._sources = buffers.sources(slots)
        self._ray_hits = buffers.ray_hits(0)
        self._features = buffers.features(0)
        self._found = buffers.found(len(self.layout.block_starts))
        self._parts, end = [], 0
        self._held, self._now = self._take_held(), _Held()
        for group in self.layout.groups:
            self._parts.append((group, self._found[end : end + group.all_blocks]))
            self._now.shapes[group.slot] = self._shape(group, end)
            end += group.all_blocks
        for group, found in self._parts:
            shape = self._now.shapes[group.slot]
            if shape is None or self._held.shapes.get(group.slot) != shape:
                self._project(group, (self._records, self._keys, self._sources), found)
                self._held.radiance.pop(group.slot, None)

    def shade(self) -> None:
        """Evaluate the colours of what is seen, in the blend space."""
        for group, found in self._parts:
            self._now.radiance[group.slot] = colors = self._colors(group)
            if self._held.radiance.get(group.slot) != colors:
                self._radiance(group, found, self._records, project.RED, self._degree)

    def find_ray_hits(self) -> None:
        """Find where the ray through each pixel meets the maximum of a splat, as
        `kernels.ray_hit` has it."""
        self._ray_hits = self._buffers.ray_hits(self.layout.slots)
        for group, found in self._parts:
            self._find_ray_hits(group, found)

    def find_features(self) -> None:
        """Compute normals, depths and albedo."""
        self._features = self._buffers.features(self.layout.slots)
        for group, found in self._parts:
            self._find_features(group, found)
            self._radiance(group, found, self._features, feature.ALBEDO, 0)

    def sort(self, matte: tuple[tuple[str, bool], ...], *, labels: bool) -> ProjectedSplats:
        """Return the visible splats, nearest first.

        Args:
            matte: As `View.matte` has it.
            labels: Whether the number of each one's prim is needed.
        """
        layout, buffers, now, held = self.layout, self._buffers, self._now, self._held
        for group in layout.groups:
            self._name_rows(group, self._sources)
        if held.stamp and None not in now.shapes.values() and now.shapes == held.shapes:
            now.order, now.stamp = held.order, held.stamp
        else:
            now.order, now.stamp = self._depth_order(), object()
        order = now.order
        ordered = buffers.ordered(order.shape[0])
        if now.stamp is not held.stamp or now.radiance != held.radiance or not self._is_ordered:
            ordered = self._gather(buffers.ordered, order, self._records)
        ray_hits = self._gather(buffers.ordered_ray_hits, order, self._ray_hits)
        features = self._gather(buffers.ordered_features, order, self._features)
        for each in self._holding:
            each.content = now
        # other modes draw into the records in their order
        is_plain = self.settings.display_mode == "splats"
        buffers.ordered.content = now if is_plain else None
        holds = [is_matte(path, matte) for path in layout.prims]
        keep = np.array([not each for each in holds], np.float32)[layout.labels[:, 0]]
        return ProjectedSplats(
            records=ordered,
            order=order,
            sources=self._sources,
            layout=layout,
            ray_hits=ray_hits,
            features=features,
            keeps=self._label(buffers.keeps, order, keep, not keep.all()),
            labels=self._label(buffers.labels, order, layout.labels[:, 0].copy(), labels),
            is_parallel=self._screen.orthographic,
            near=self._screen.clipping_range[0],
            stamp=now.stamp if is_plain else object(),
        )

    # --- what holds ------------------------------------------------------------------------

    def _take_held(self) -> _Held:
        """Take what the last picture left in the buffers, which are about to be written."""
        first, *others = (each.content for each in self._holding)
        ordered = self._buffers.ordered
        self._is_ordered = first is not None and ordered.content is first
        for each in (*self._holding, ordered):
            each.content = None
        holds = first is not None and all(each is first for each in others)
        return first if holds else _Held()

    @property
    def _holding(self) -> tuple[Memory, ...]:
        """Buffers whose contents are kept for the next picture."""
        b = self._buffers
        return b.records, b.keys, b.sources, b.found, b.sort_slots

    def _shape(self, group: Group, first: int) -> Any:
        """All that the footprints of a group depend on, `first` its first block; None where a
        budget leaves a part of it, whose rows are renamed."""
        if group.rows is not None:
            return None
        arrays = self.matrices(group), self.record(group), group.transforms
        field = group.field
        return first, field.shapes, field.crops, *(array.tobytes() for array in arrays)

    # --- one group -------------------------------------------------------------------------

    @property
    def window(self) -> tuple[int, int, int, int]:
        """Data window [pixel]: x0, y0, x1, y1, end exclusive."""
        return self._screen.window

    def degree(self, group: Group) -> int:
        """Of the harmonics that are evaluated."""
        return min(self.settings.sh_degree, group.cloud.sh_degree)

    def conversion(self, group: Group) -> tuple[F32, bool]:
        """From the field's space to the one in which splats are blended: 13 numbers, and whether
        they change anything."""
        spec = group.field.spec
        numbers = conversion(spec.color_space, self._blend_space, grade=spec.grade)
        return numbers, not is_identity(numbers)

    def matrices(self, group: Group) -> F64:
        """Local to camera, shape (m, 3, 4)."""
        return np.asarray(self._screen.world_to_camera[:3] @ group.transforms)

    def record(self, group: Group) -> npt.NDArray[Any]:
        """The view as `project` reads it: one CAMERA record."""
        spec, mode = group.field.spec, self.settings.rasterize_mode
        shape = self.settings.display_mode
        return self._screen.record(
            tangential=spec.projection_mode == "tangential",
            by_distance=self.settings.sorting == "cameraDistance",
            antialiased=(spec.rasterize_mode if mode == "auto" else mode) == "antialiased"
            and shape not in ("points", "ellipses"),  # which would vanish in the distance
            margin=DOT_REACH if shape == "points" else 0,
        )

    def _project(self, group: Group, out: Any, found: I32) -> None:
        keep, run = self._device.keep, self._device.run
        laid = group.field.laying.of(self._device, group.cloud)
        record, matrices = self.record(group), self.matrices(group)
        shapes, crops = volumes(group.field.crops, group.transforms)
        closed = self._buffers.closed(len(matrices) * len(laid.boxes))
        if len(laid.boxes):
            run(blocks.cull, record, matrices, keep(laid.boxes), closed)
        run(
            project.project, record, matrices, shapes, crops, keep(laid.rows),
            keep(laid.positions), keep(laid.rotations), keep(laid.scales), keep(laid.opacities),
            closed, group.block, group.slot, out, found,
        )  # fmt: skip

    def _colors(self, group: Group) -> Any:
        """All that the colours of a group depend on besides its footprints."""
        numbers, _ = self.conversion(group)
        return group.field.radiance, self.sights(group).tobytes(), self._degree, numbers.tobytes()

    def _radiance(self, group: Group, found: I32, paints: F32, column: int, degree: int) -> None:
        keep = self._device.keep
        numbers, converts = self.conversion(group)
        self._device.run(
            radiance.radiance, self.sights(group), keep(group.cloud.positions),
            keep(group.cloud.sh), min(degree, group.cloud.sh_degree), numbers,
            converts, group.block, group.slot, self._sources, found, paints, column,
        )  # fmt: skip

    def _find_ray_hits(self, group: Group, found: I32) -> None:
        cloud, keep = group.cloud, self._device.keep
        matrices = self.matrices(group)
        self._device.run(
            ray_hit.ray_hits, self.record(group), matrices, _inverses(matrices),
            keep(cloud.positions), keep(cloud.rotations), keep(cloud.scales), group.block,
            group.slot, self._records, self._sources, found, self._ray_hits,
        )  # fmt: skip

    def _find_features(self, group: Group, found: I32) -> None:
        cloud, keep = group.cloud, self._device.keep
        matrices = self.matrices(group)
        self._device.run(
            feature.features, matrices, _inverses(matrices), self._screen.orthographic,
            keep(cloud.positions), keep(cloud.rotations), keep(cloud.scales), group.block,
            group.slot, self._sources, found, self._records, self._features,
        )  # fmt: skip

    def sights(self, group: Group) -> F64:
        """Affine maps from a splat's position to its direction of sight in the field's own space.

        A = Q P with Q orthogonal, reflections included: directions go back by Qᵀ, so Qᵀ A = P
        takes the positions. Of an orthographic camera the direction is the same everywhere. Shape
        (m, 3, 4).
        """
        screen, back = self._screen, group.turns.transpose(0, 2, 1)
        sights = np.zeros((len(back), 3, 4))
        if screen.orthographic:
            sights[:, :, 3] = back @ screen.forward
        else:
            sights[:, :, :3] = group.stretches
            sights[:, :, 3:] = back @ (group.transforms[:, :3, 3:] - screen.eye[:, None])
        return sights

    def _name_rows(self, group: Group, sources: Any) -> None:
        """Where a budget leaves a part of a field, go from rows of the part to its own."""
        if group.rows is not None and group.slots > 0:
            used = sources[group.slot : group.slot + group.slots]
            self._device.run(sort.name_rows, self._device.keep(group.rows), used)

    # --- all groups ------------------------------------------------------------------------

    def _depth_order(self) -> I32:
        """Return the slots of the visible splats, nearest first."""
        found, keys, sources = self._found, self._keys, self._sources
        run, buffers, threads = self._device.run, self._buffers, self._device.threads
        visible = buffers.visible(self.layout.slots)
        starts = self._device.keep(self.layout.block_starts)
        total = run(sort.visible_slots, found, starts, found.shape[0], visible)
        work = buffers.sort_keys(total), buffers.sort_slots(total)
        histogram = buffers.histogram(4 * threads)
        half = run(sort.depth_order, visible, total, keys, 4 * threads, work, histogram)
        order: I32 = work[1][half]
        if any(group.field.laying.is_made for group in self.layout.groups):
            first_slots = self._device.keep(self.layout.first_slots)
            ties = buffers.ties(total)
            run(sort.settle, work[0][half], order, total, sources, first_slots, ties)
        return order

    def _gather(self, buffer: Memory, order: I32, rows: F32) -> F32:
        """Rows of the slots in order of depth; nothing of nothing."""
        count = order.shape[0] if rows.shape[0] > 0 else 0
        out: F32 = buffer(count)
        if count > 0:
            self._device.run(sort.gather, order, rows, out)
        return out

    def _label(self, buffer: Memory, order: I32, numbers: Any, wanted: bool) -> Any:
        """What belongs to the appearance of each splat, in order of depth."""
        count = order.shape[0] if wanted else 0
        out = buffer(count)
        if count > 0:
            first_slots = self._device.keep(self.layout.first_slots)
            self._device.run(feature.labels, order, first_slots, self._device.keep(numbers), out)
        return out


def _inverses(matrices: F64) -> F64:
    """Inverses of the 3x3 of local-to-camera matrices; flat ones count as hardly thick."""
    linear = matrices[:, :, :3]
    try:
        inverses = np.linalg.inv(linear)
    except np.linalg.LinAlgError:
        u, s, vt = np.linalg.svd(linear)
        s = np.maximum(s, ray_hit.THIN * s[:, :1])
        s[s == 0] = 1.0
        inverses = (vt.transpose(0, 2, 1) / s[:, None]) @ u.transpose(0, 2, 1)
    return np.ascontiguousarray(inverses)
