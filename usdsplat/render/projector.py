"""Project, shade and sort the splats of a view."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.core.errors import UsageError
from usdsplat.images.color import conversion, conversion_curve, is_identity
from usdsplat.kernels import blocks, casters, feature, project, radiance, ray_hit, receivers, sort
from usdsplat.kernels.device import Device
from usdsplat.render.buffers import Memory
from usdsplat.render.crop_volumes import volumes
from usdsplat.render.draw_list import DrawList, Group, Placements
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.group_gains import NO_GAINS, Gains
from usdsplat.render.matte import is_matte
from usdsplat.render.projected_splats import HeldInputs, ProjectedSplats
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.spatial_order import OrderedSplats
from usdsplat.render.specs import FieldSpec
from usdsplat.render.splat_normals import NO_SURFACE

BEHIND = -1e30
"""Depth of hidden instances, in front of every near plane [scene unit]."""
NO_ROWS = np.empty(0, np.int32)
NO_WEIGHTS: F32 = np.empty(0, np.float32)
Paint = Callable[[Group, I32, I32, F32, F32], None]
"""Write rows of features of a group, given rows of its field, `Projector._found`, records by slot,
and the features."""
DOT_REACH = 4
"""Distance beyond the data window within which display mode points keeps splats [pixel]. Their dots
may be larger than the splats."""


class Projector:
    """The steps from a scene's splats to the sorted splats of a view.

    After `lay_out`, `project`, `shade`, `find_ray_hits` and `find_features` fill rows of splats in
    the order of storage; `sort` gathers them by depth. A step with unchanged inputs is skipped.

    Args:
        layout: The splats to draw.
        blend_space: Colour space in which splats are blended.
        inner: Projection of the coarse levels of splat trees, if it is another.
        gains: Factors on the linear colours of lit groups, by their first slot.

    Raises:
        UsageError: If the scene has 2**31 splats or more.
    """

    def __init__(
        self,
        device: Device,
        buffers: FrameBuffers,
        layout: DrawList,
        screen: Screen,
        settings: RenderSettings,
        blend_space: str,
        inner: Screen | None = None,
        gains: Gains = NO_GAINS,
    ) -> None:
        self._device = device
        self._buffers = buffers.splats
        self.layout = layout
        self._screen, self._inner = screen, inner or screen
        self.settings = settings
        self._blend_space = blend_space
        self._gains = gains
        self._is_ordered = False
        if self.layout.slots > np.iinfo(np.int32).max:
            found = f"{self.layout.slots} splats in one view"
            raise UsageError("scene", found, "less than 2**31")

    # --- the steps, in their order ---------------------------------------------------------

    def lay_out(self) -> None:
        """Take buffers, and choose the order in memory of the fields to project."""
        buffers, slots = self._buffers, self.layout.slots
        self._records = buffers.records(slots)
        self._keys, self._sources = buffers.keys(slots), buffers.sources(slots)
        self._ray_hits = buffers.ray_hits(0)
        self._features = buffers.features(0)
        self._found = buffers.found(len(self.layout.block_starts))
        self._parts, self._stale, end = [], [], 0
        self._held, self._now = self._take_held(), HeldInputs()
        for group in self.layout.groups:
            found = self._found[end : end + group.all_blocks]
            self._parts.append((group, found))
            self._now.shapes[group.slot] = shape = self._shape(group, end)
            if shape is None or self._held.shapes.get(group.slot) != shape:
                laid = group.field.spatial_order.of(self._device, group.cloud)
                self._stale.append((group, found, laid))
            end += group.all_blocks

    def project(self) -> None:
        """Project all splats, and record which ones may be visible."""
        for group, found, laid in self._stale:
            self._project(group, laid, (self._records, self._keys, self._sources), found)
            self._held.radiance.pop(group.slot, None)

    def shade(self) -> None:
        """Evaluate the colours of the visible splats in the blend space."""
        for group, found in self._parts:
            self._now.radiance[group.slot] = colors = self._colors(group)
            if self._held.radiance.get(group.slot) != colors:
                self._radiance(group, found, self._records, project.RED, self.settings.sh_degree)
                self._dim(group, found)

    def find_ray_hits(self) -> None:
        """Compute the coefficients of ray hits, see `kernels.ray_hit`."""
        self._ray_hits = self._buffers.ray_hits(self.layout.slots)
        for group, found in self._parts:
            self._find_ray_hits(group, found)

    def order_casters(self) -> None:
        """Let `sort` sort splats by the depth from which on they cast shadows, not by their own."""
        self._device.run(casters.order_casters, self._ray_hits, self._keys)

    def find_features(self, *, with_normals: bool) -> None:
        """Compute axes, depths and albedo, and `with_normals` those of surfaces."""
        self._features = self._buffers.features(self.layout.slots)
        for group, found in self._parts:
            self._find_features(group, found, with_normals=with_normals)
            self._radiance(group, found, self._features, feature.ALBEDO, 0)

    def sort(self, matte: tuple[tuple[str, bool], ...], *, labels: bool) -> ProjectedSplats:
        """Return the visible splats, nearest first.

        Args:
            matte: See `View.matte`.
            labels: Whether the number of each splat's prim is needed.
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
        # other modes overwrite the sorted records
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

    # --- reuse between pictures ------------------------------------------------------------

    def _take_held(self) -> HeldInputs:
        """Return the inputs of the last picture, and mark its buffers as overwritten."""
        first, *others = (each.content for each in self._holding)
        ordered = self._buffers.ordered
        self._is_ordered = first is not None and ordered.content is first
        for each in (*self._holding, ordered):
            each.content = None
        holds = first is not None and all(each is first for each in others)
        return first if holds else HeldInputs()

    @property
    def _holding(self) -> tuple[Memory, ...]:
        """Buffers whose contents are kept for the next picture."""
        b = self._buffers
        return b.records, b.keys, b.sources, b.found, b.sort_slots

    def _shape(self, group: Group, first: int) -> Any:
        """Return everything that the footprints of a group depend on. `first` is its first block.

        Return None for a group that a budget reduces, because its rows are renumbered.
        """
        if group.rows is not None:
            return None
        arrays = (
            self.matrices(group), self.weights(group), self.record(group),
            group.placements.transforms,
        )  # fmt: skip
        field = group.field
        return first, field.shapes, field.crops, *(array.tobytes() for array in arrays)

    # --- one group -------------------------------------------------------------------------

    @property
    def window(self) -> tuple[int, int, int, int]:
        """Data window [pixel]: x0, y0, x1, y1, end exclusive."""
        return self._screen.window

    def degree(self, group: Group) -> int:
        """Return the degree of the harmonics that are evaluated."""
        return min(self.settings.sh_degree, group.cloud.sh_degree)

    def conversion(self, group: Group) -> tuple[F32, bool]:
        """Return the conversion from the field's colour space to the blend space: 13 numbers, and
        whether they change anything."""
        spec = group.field.spec
        numbers = conversion(spec.color_space, self._blend_space, grade=spec.grade)
        return numbers, not is_identity(numbers)

    def matrices(self, group: Group) -> F64:
        """Return the local-to-camera matrices, shape (m, 3, 4)."""
        found = self.to_camera(group.placements)
        weights = self.weights(group)
        if len(weights):
            found[weights == 0, 2, 3] = BEHIND
        return found

    def weights(self, group: Group) -> F32:
        """Return the weights that fade the instances, shape (m,); empty if all are 1."""
        found = self.layout.weights
        return NO_WEIGHTS if found is None else found[group.appearances]

    def to_camera(self, placements: Placements) -> F64:
        """Return local-to-camera matrices, shape (m, 3, 4)."""
        return np.asarray(self._screen.world_to_camera[:3] @ placements.transforms)

    def record(self, group: Group) -> npt.NDArray[Any]:
        """Return the CAMERA record of `project` for a group."""
        spec = group.field.spec
        screen = self._inner if group.field.is_inner else self._screen
        return screen.record(
            tangential=spec.projection_mode == "tangential",
            by_distance=self.settings.sorting == "cameraDistance",
            footprint=self._footprint(spec, group.field.is_inner),
            margin=DOT_REACH if self.settings.display_mode == "points" else 0,
        )

    def _footprint(self, spec: FieldSpec, is_inner: bool) -> float:
        """Return the size of a pixel from which on the low-pass lowers the opacity [local unit]."""
        asked = "antialiased" if is_inner else self.settings.rasterize_mode
        mode = spec.drawn_mode(asked)
        if mode == "classic" or self.settings.display_mode in ("points", "ellipses"):
            return math.inf  # points and ellipses would otherwise vanish in the distance
        return spec.footprint if mode == "footprint" else 0.0

    def _project(self, group: Group, laid: OrderedSplats, out: Any, found: I32) -> None:
        keep, run = self._device.keep, self._device.run
        record, matrices = self.record(group), self.matrices(group)
        shapes, crops = volumes(group.field.crops, group.placements.transforms)
        closed = self._buffers.closed(len(matrices) * len(laid.boxes))
        if len(laid.boxes):
            run(blocks.cull, record, matrices, keep(laid.boxes), closed)
        run(
            project.project, record, matrices, self.weights(group), shapes, crops, keep(laid.rows),
            keep(laid.positions), keep(laid.rotations), keep(laid.scales), keep(laid.opacities),
            closed, group.block, group.slot, out, found,
        )  # fmt: skip

    def _colors(self, group: Group) -> Any:
        """Return everything that the colours of a group depend on besides its footprints."""
        numbers, _ = self.conversion(group)
        return (
            group.field.radiance,
            self.sights(group.placements).tobytes(),
            self.settings.sh_degree,
            numbers.tobytes(),
            self._gains[group.slot].token if group.slot in self._gains else None,
        )

    def _radiance(self, group: Group, found: I32, paints: F32, column: int, degree: int) -> None:
        keep = self._device.keep
        numbers, converts = self.conversion(group)
        self._device.run(
            radiance.radiance, self.sights(group.placements), keep(group.cloud.positions),
            keep(group.cloud.sh), min(degree, group.cloud.sh_degree), numbers,
            converts, group.block, group.slot, self._sources, found, paints, column,
        )  # fmt: skip

    def _dim(self, group: Group, found: I32) -> None:
        """Multiply the colours of a group by its gains."""
        if group.slot not in self._gains:
            return
        gains = self._gains[group.slot]
        rows = self._device.keep(NO_ROWS if group.rows is None else group.rows)
        curve = conversion_curve(self._blend_space)
        self._device.run(
            receivers.dim, gains.factors, len(group.field.spec.cloud), len(group.cloud),
            rows, curve, gains.turns(self._blend_space), group.block, group.slot, self._sources,
            found, self._records, project.RED,
        )  # fmt: skip

    def painted(self, order: I32, out: Memory, paint: Paint) -> F32:
        """Return rows of features, in order of depth, that `paint` has written for each group.

        They are rows of a buffer, `out`, that the next call with it overwrites.
        """
        buffer = self._buffers.features(self.layout.slots)
        for group, found in self._parts:
            paint(group, self._sources, found, self._records, buffer)
        return self._gather(out, order, buffer)

    def labelled(self, order: I32, numbers: I32 | F32) -> Any:
        """Return `numbers` of the appearances, one for each, by splat in order of depth."""
        buffers = self._buffers
        buffer = buffers.catches if numbers.dtype == np.float32 else buffers.labels
        return self._label(buffer, order, numbers, True)

    def _find_ray_hits(self, group: Group, found: I32) -> None:
        cloud, keep = group.cloud, self._device.keep
        matrices = self.matrices(group)
        self._device.run(
            ray_hit.ray_hits, self.record(group), matrices, ray_hit.inverses(matrices),
            keep(cloud.positions), keep(cloud.rotations), keep(cloud.scales), group.block,
            group.slot, self._records, self._sources, found, self._ray_hits,
        )  # fmt: skip

    def _find_features(self, group: Group, found: I32, *, with_normals: bool) -> None:
        cloud, keep = group.cloud, self._device.keep
        matrices = self.matrices(group)
        surface = group.field.surface_values(group.rows) if with_normals else NO_SURFACE
        self._device.run(
            feature.features, matrices, ray_hit.inverses(matrices), self._screen.orthographic,
            keep(cloud.positions), keep(cloud.rotations), keep(cloud.scales),
            keep(surface.normals), keep(surface.facts), group.block, group.slot, self._sources,
            found, self._records, self._features,
        )  # fmt: skip

    def sights(self, placements: Placements) -> F64:
        """Return affine maps from a splat's position to its view direction in local space.

        Shape (m, 3, 4). With A = Q P and Q orthogonal, reflections included, directions go back to
        local space by Qᵀ, and Qᵀ A = P applies to the positions. For an orthographic camera the
        direction is constant.
        """
        screen, back = self._screen, placements.turns.transpose(0, 2, 1)
        sights = np.zeros((len(back), 3, 4))
        if screen.orthographic:
            sights[:, :, 3] = back @ screen.forward
        else:
            sights[:, :, :3] = placements.stretches
            sights[:, :, 3:] = back @ (placements.transforms[:, :3, 3:] - screen.eye[:, None])
        return sights

    def _name_rows(self, group: Group, sources: Any) -> None:
        """Convert rows of a splat budget's subset to rows of the field."""
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
        if any(group.field.spatial_order.is_made for group in self.layout.groups):
            first_slots = self._device.keep(self.layout.first_slots)
            ties = buffers.ties(total)
            run(sort.settle, work[0][half], order, total, sources, first_slots, ties)
        return order

    def _gather(self, buffer: Memory, order: I32, rows: F32) -> F32:
        """Return the rows of the slots in order of depth; empty if `rows` is empty."""
        count = order.shape[0] if rows.shape[0] > 0 else 0
        out: F32 = buffer(count)
        if count > 0:
            self._device.run(sort.gather, order, rows, out)
        return out

    def _label(self, buffer: Memory, order: I32, numbers: Any, wanted: bool) -> Any:
        """Return the number of each splat's appearance, in order of depth; empty if not
        wanted."""
        count = order.shape[0] if wanted else 0
        out = buffer(count)
        if count > 0:
            first_slots = self._device.keep(self.layout.first_slots)
            self._device.run(feature.labels, order, first_slots, self._device.keep(numbers), out)
        return out
