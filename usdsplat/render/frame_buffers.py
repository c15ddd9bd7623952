"""Buffers of a frame, reused from picture to picture."""

from __future__ import annotations

from typing import Any, get_type_hints

import numpy as np

from usdsplat.kernels import cryptomatte, feature, lighting, project, ray_hit, sort, weigh
from usdsplat.render.buffers import Buffer, BufferGroup, Empty, KernelBuffers, LentMemory

F32, I32, I64, U8, U32 = np.float32, np.int32, np.int64, np.uint8, np.uint32


class SplatBuffers(BufferGroup):
    """Splats of one view, first by slot of the draw list, then sorted nearest first.

    Visible splats are packed at the beginning of their block. Many pages of wide rows are therefore
    never touched.
    """

    records = Buffer(
        lambda slots: (slots, project.RECORD),
        F32,
        touched=lambda visible: (visible, project.RECORD),
    )
    """Footprints, shape (slots, RECORD)."""
    keys = Buffer(lambda slots: (slots,), F32)
    """Depths by which splats are sorted, shape (slots,)."""
    sources = Buffer(lambda slots: (slots,), I32)
    """Row of each slot in its field, shape (slots,)."""
    found = Buffer(lambda blocks: (blocks,), I32)
    """Visible splats of each block, shape (blocks,)."""
    closed = Buffer(lambda boxes: (boxes,), U8)
    """Whether a bounded block is out of view, shape (boxes,), for one group at a time."""
    ray_hits = Buffer(
        lambda slots: (slots, ray_hit.RAY_HIT),
        F32,
        touched=lambda visible: (visible, ray_hit.RAY_HIT),
    )
    """Ray hits, shape (slots, RAY_HIT)."""
    features = Buffer(
        lambda slots: (slots, feature.FEATURES), F32,
        touched=lambda visible: (visible, feature.FEATURES),
    )  # fmt: skip
    """Normals, albedo, axes and depths, shape (slots, FEATURES)."""
    visible = Buffer(lambda slots: (slots,), I32, touched=lambda visible: (visible,))
    """Slots of visible splats, shape (slots,)."""
    sort_keys = Buffer(lambda visible: (2, visible), U32)
    """Keys of the sort, source and destination of a pass, shape (2, visible)."""
    sort_slots = Buffer(lambda visible: (2, visible), I32)
    """Slots that belong to `sort_keys`, shape (2, visible)."""
    histogram = Buffer(lambda chunks: (chunks, sort.DIGITS), I64)
    """Counts of digits, shape (chunks, DIGITS)."""
    ties = Buffer(lambda visible: (visible,), I64)
    """Splats of equal depth, needed if memory is not in the order of rows, shape (visible,)."""
    ordered = Buffer(lambda visible: (visible, project.RECORD), F32)
    """`records` in order of depth, shape (visible, RECORD)."""
    ordered_ray_hits = Buffer(lambda visible: (visible, ray_hit.RAY_HIT), F32)
    """`ray_hits` in order of depth, shape (visible, RAY_HIT)."""
    ordered_features = Buffer(lambda visible: (visible, feature.FEATURES), F32)
    """`features` in order of depth, shape (visible, FEATURES)."""
    ordered_ratios = Buffer(lambda drawn: (drawn, feature.FEATURES), F32)
    """Ratios of light in the columns of albedo, in order of depth, shape (drawn, FEATURES)."""
    ordered_light = Buffer(lambda drawn: (drawn, feature.FEATURES), F32)
    """Light, or colours by some lights, in the same columns, shape (drawn, FEATURES)."""
    catches = Buffer(lambda drawn: (drawn,), F32)
    """1 for splats of shadow catchers, shape (drawn,)."""
    keeps = Buffer(lambda visible: (visible,), F32)
    """0 for splats that only hold out, shape (visible,)."""
    labels = Buffer(lambda visible: (visible,), I32)
    """Number of each splat's prim, shape (visible,)."""
    groups = Buffer(lambda drawn: (drawn,), I32)
    """Group of each splat in the layer of Cryptomatte that is being weighed, shape (drawn,)."""
    numbered = Buffer(lambda visible: (visible, project.RECORD), F32)
    """`ordered` with ranks in place of colours, for deep ids, shape (visible, RECORD)."""


class DisplayBuffers(BufferGroup):
    """Splats that a display mode draws instead of the visible ones, nearest first."""

    opaque = Buffer(lambda visible: (visible,), U8)
    """Whether an ellipse is drawn, shape (visible,)."""
    records = Buffer(lambda shown: (shown, project.RECORD), F32)
    """Footprints, shape (shown, RECORD)."""
    order = Buffer(lambda shown: (shown,), I32)
    """Slots, shape (shown,)."""
    ray_hits = Buffer(lambda shown: (shown, ray_hit.RAY_HIT), F32)
    """Ray hits, shape (shown, RAY_HIT)."""
    features = Buffer(lambda shown: (shown, feature.FEATURES), F32)
    """Normals, albedo, axes and depths, shape (shown, FEATURES)."""
    keeps = Buffer(lambda shown: (shown,), F32)
    """0 for splats that only hold out, shape (shown,)."""
    labels = Buffer(lambda shown: (shown,), I32)
    """Number of each splat's prim, shape (shown,)."""


class TileBuffers(KernelBuffers):
    """Lists of the splats of each tile, filled by `kernels.bins.tile_lists`."""

    row_places = Buffer(lambda chunks, tile_rows: (chunks, tile_rows + 1), I64)
    """Offset at which each chunk writes in each row of tiles, shape (chunks, tile rows + 1)."""
    row_ends = Buffer(lambda tile_rows: (tile_rows,), I64)
    """End of each row's crossings, shape (tile rows,)."""
    crossings = Buffer(lambda crossings: (crossings, 2), I32)
    """Splat and columns of each crossing, shape (crossings, 2)."""
    counts = Buffer(lambda tile_rows, tile_columns: (tile_rows, tile_columns + 1), I32)
    """Number of splats of each tile, shape (tile rows, tile columns + 1)."""
    starts = Buffer(lambda tile_rows, tile_columns: (tile_rows * tile_columns + 1,), I64)
    """First pair of each tile, shape (tiles + 1,)."""
    lists = Buffer(lambda pairs: (pairs,), I32)
    """Splats of each tile, tile after tile, shape (pairs,)."""
    work = Buffer(lambda tile_rows, tile_columns: (tile_rows * tile_columns,), I64)
    """Pairs of a splat and a block of 4x4 pixels blended in each tile, shape (tiles,)."""


class ImageBuffers(BufferGroup):
    """One blended feature of the splats of a band."""

    image = Buffer(lambda height, width: (height, width, 4), F32)
    """Three sums and coverage, shape (h, w, 4)."""
    through = Buffer(lambda height, width: (height, width), F32)
    """Transmittance where it is not 1 - coverage, shape (h, w)."""


class NearestBuffers(BufferGroup):
    """Depth and ids of the splat at which a given part of a pixel's coverage is reached."""

    ranks = Buffer(lambda height, width: (height, width), I32)
    """Rank of the splat, shape (h, w)."""
    ray_depths = Buffer(lambda height, width: (height, width), F32)
    """Depths of ray hits, used if contributions are evaluated one by one, shape (h, w)."""
    depth = Buffer(lambda height, width: (height, width), F32)
    """Planar depth, shape (h, w)."""
    ids = Buffer(lambda height, width: (4, height, width), I32)
    """Prim, instance, element, and row of the appearance, shape (4, h, w)."""


class PixelBuffers(BufferGroup):
    """Further AOVs of a band, and intermediate arrays for them."""

    left = Buffer(lambda height, width: (height, width), F32)
    """Transmittance of the splats to the surfaces, shape (h, w)."""
    normals = Buffer(lambda height, width: (height, width, 3), F32)
    """Unit normals, shape (h, w, 3)."""
    shadow = Buffer(lambda height, width: (height, width, 3), F32)
    """Ratio of the light with and without shadows, shape (h, w, 3)."""
    irradiance = Buffer(lambda height, width: (height, width, 3), F32)
    """Mean light that arrives, shape (h, w, 3)."""
    lights = Buffer(lambda light_parts, height, width: (light_parts * height, width, 4), F32)
    """Parts of the colours by lights, one after the other, shape (parts h, w, 4)."""
    axes = Buffer(lambda height, width: (height, width, 3), F32)
    """Unit normals by the splats' thinnest axes, shape (h, w, 3)."""
    confidence = Buffer(lambda height, width: (height, width), F32)
    """Mean confidence of the normals, shape (h, w)."""
    occlusion = Buffer(lambda height, width: (height, width), F32)
    """Mean occlusion, shape (h, w)."""
    expected_depth = Buffer(lambda height, width: (height, width), F32)
    """Mean depths, shape (h, w)."""
    positions = Buffer(lambda height, width: (height, width, 3), F32)
    """World positions, shape (h, w, 3)."""
    motion_forward = Buffer(lambda height, width: (height, width, 2), F32)
    """Motion to the next frame [pixel], shape (h, w, 2)."""
    motion_backward = Buffer(lambda height, width: (height, width, 2), F32)
    """Motion from the previous frame [pixel], shape (h, w, 2)."""
    motion_rows = Buffer(lambda height, width: (height, width), I32)
    """Row of the moving appearance, splats or surfaces, shape (h, w)."""
    motion_elements = Buffer(lambda height, width: (height, width), I32)
    """Splat or triangle of that appearance, shape (h, w)."""
    motion_weights = Buffer(lambda height, width: (height, width, 2), F32)
    """Barycentric weights in the triangle, shape (h, w, 2)."""
    holdout_depth = Buffer(lambda height, width: (height, width), F32)
    """Depths of a flat holdout without surfaces, shape (h, w)."""
    holdout_covered = Buffer(lambda height, width: (height, width), U8)
    """Whether the holdout covers a pixel, shape (h, w)."""
    deep_offsets = Buffer(lambda height, width: (height * width + 1,), I64)
    """First deep sample of each pixel, shape (h w + 1,)."""


def kept(rank_pairs: int) -> int:
    """Return the number of prims of a pixel that are kept for each sample."""
    return max(weigh.RANKS, 2 * rank_pairs)


def slots(rank_pairs: int) -> int:
    """Return the number of prims of a pixel that are accumulated over samples."""
    return cryptomatte.SLOTS_PER_PRIM * kept(rank_pairs)


class MatteBuffers(BufferGroup):
    """One layer of Cryptomatte of a band."""

    prims = Buffer(lambda height, width, rank_pairs: (height, width, kept(rank_pairs)), I32)
    """Groups of prims that contribute most to a sample, shape (h, w, kept)."""
    weights = Buffer(lambda height, width, rank_pairs: (height, width, kept(rank_pairs)), F32)
    """Their contributions, shape (h, w, kept)."""
    surfaces = Buffer(lambda height, width: (height, width), I32)
    """Groups of the surfaces, shape (h, w)."""
    all_prims = Buffer(lambda height, width, rank_pairs: (height, width, slots(rank_pairs)), I32)
    """Groups of prims that contributed to all samples, shape (h, w, slots)."""
    all_weights = Buffer(lambda height, width, rank_pairs: (height, width, slots(rank_pairs)), F32)
    """Their contributions, shape (h, w, slots)."""
    ranked = Buffer(lambda height, width, rank_pairs: (height, width, 4 * rank_pairs), F32)
    """Ranked (hash, coverage) pairs, shape (h, w, 4 rank pairs)."""


class SurfaceBuffers(BufferGroup):
    """Surfaces of a band, see `surfaces.SurfaceBand`."""

    winner = Buffer(lambda height, width: (height, width), I32)
    """Nearest triangle, shape (h, w)."""
    depth = Buffer(lambda height, width: (height, width), F32)
    """Shape (h, w)."""
    color = Buffer(lambda height, width: (height, width, 3), F32)
    """Shape (h, w, 3)."""
    normal = Buffer(lambda height, width: (height, width, 3), F32)
    """Shape (h, w, 3)."""
    albedo = Buffer(lambda height, width: (height, width, 3), F32)
    """Shape (h, w, 3)."""
    covered = Buffer(lambda height, width: (height, width), U8)
    """Shape (h, w)."""
    ids = Buffer(lambda height, width: (3, height, width), I32)
    """Shape (3, h, w)."""
    hit = Buffer(lambda height, width: (2, height, width), I32)
    """Shape (2, h, w)."""
    bary = Buffer(lambda height, width: (height, width, 2), F32)
    """Shape (h, w, 2)."""


class LitBuffers(BufferGroup):
    """Surfaces of a band as receivers of light, pixel after pixel."""

    points = Buffer(lambda height, width: (height * width, 3), np.float64)
    """Positions in the world, shape (h w, 3)."""
    normals = Buffer(lambda height, width: (height * width, 4), F32)
    """Unit normals and 1, shape (h w, 4)."""
    prims = Buffer(lambda height, width: (height * width,), I32)
    """Number of the prim, -1 for none, shape (h w,)."""
    sums = Buffer(lambda height, width: (height * width, lighting.SUMS), F32)
    """Light with and without shadows, shape (h w, SUMS)."""
    seen = Buffer(lambda height, width: (height * width, lighting.SUMS), F32)
    """The same of the directions of a dome, shape (h w, SUMS)."""
    ratios = Buffer(lambda height, width: (height * width, 3), F32)
    """Their ratio, shape (h w, 3)."""
    one = Buffer(lambda height, width: (height * width, lighting.SUMS), F32)
    """As `sums`, of one light, shape (h w, SUMS)."""
    parts = Buffer(lambda light_parts, height, width: (light_parts, height * width, 3), F32)
    """Light of each part, shape (parts, h w, 3)."""
    colors = Buffer(lambda height, width: (height, width, 3), F32)
    """Colours of surfaces by one part, shape (h, w, 3)."""


class TriangleBuffers(KernelBuffers):
    """Lists of the triangles of each tile, filled by `kernels.raster.tile_lists`."""

    PREFIX = "surface "

    counts = Buffer(
        lambda chunks, tile_rows, tile_columns: (chunks, tile_rows * tile_columns + 1), I32
    )
    """Number of triangles of each tile, shape (chunks, tiles + 1)."""
    starts = Buffer(lambda tile_rows, tile_columns: (tile_rows * tile_columns + 1,), I64)
    """First pair of each tile, shape (tiles + 1,)."""
    lists = Buffer(lambda triangle_pairs: (triangle_pairs,), I32)
    """Triangles of each tile, tile after tile, shape (pairs,)."""


class SumBuffers(BufferGroup):
    """Sums over the samples of a band."""

    shadow = Buffer(lambda height, width: (height, width, 3), F32)
    """Shape (h, w, 3)."""
    irradiance = Buffer(lambda height, width: (height, width, 3), F32)
    """Shape (h, w, 3)."""
    lights = Buffer(lambda light_parts, height, width: (light_parts * height, width, 3), F32)
    """Shape (parts h, w, 3)."""
    color = Buffer(lambda height, width: (height, width, 4), F32)
    """Shape (h, w, 4)."""
    albedo = Buffer(lambda height, width: (height, width, 3), F32)
    """Shape (h, w, 3)."""


class LayerBuffers(BufferGroup):
    """Sums of the splat layers of repeated samples of a band, in the blend space."""

    color = Buffer(lambda height, width: (height, width, 4), F32)
    """Shape (h, w, 4)."""
    albedo = Buffer(lambda height, width: (height, width, 4), F32)
    """Shape (h, w, 4)."""
    left = Buffer(lambda height, width: (height, width), F32)
    """Shape (h, w)."""
    lights = Buffer(lambda light_parts, height, width: (light_parts * height, width, 4), F32)
    """Shape (parts h, w, 4)."""


MATTES = {
    "cryptoObject": "crypto_object",
    "cryptoAsset": "crypto_asset",
    "cryptoMaterial": "crypto_material",
}
"""Layer of Cryptomatte -> its group of buffers."""


class FrameBuffers:
    """All buffers of a frame, reused by the next frame.

    Args:
        empty: Allocates a number of elements of a type on the device: `Device.resident`. Arrays
            stay there between kernels; the host reads copies made by `Device.fetch`.
    """

    splats: SplatBuffers
    display: DisplayBuffers
    tiles: TileBuffers
    color: ImageBuffers
    albedo: ImageBuffers
    normals: ImageBuffers
    depths: ImageBuffers
    axes: ImageBuffers
    shadows: ImageBuffers
    median: NearestBuffers
    """Splat at which half of the coverage is reached."""
    front: NearestBuffers
    """First splat that contributes."""
    pixels: PixelBuffers
    crypto_object: MatteBuffers
    crypto_asset: MatteBuffers
    crypto_material: MatteBuffers
    surfaces: SurfaceBuffers
    lit: LitBuffers
    triangles: TriangleBuffers
    sums: SumBuffers
    layers: LayerBuffers

    def __init__(self, empty: Empty) -> None:
        for name, group in self.groups().items():
            setattr(self, name, group(empty))
        self.samples = LentMemory(empty)
        """Memory of deep samples, which the caller keeps."""
        self.lights: Any = None
        """What lighting keeps between pictures, see `lights.lighting`."""
        self.fused: Any = None
        """State that a device keeps for its fused path, see `Rasterizer.draw_color`."""

    def image(self, name: str) -> ImageBuffers:
        """Return the group of "color", "albedo", "normals", "depths", "axes" or "shadows"."""
        group: ImageBuffers = getattr(self, name)
        return group

    def matte(self, layer: str) -> MatteBuffers:
        """Return the group of one of `cryptomatte.LAYERS`."""
        group: MatteBuffers = getattr(self, MATTES[layer])
        return group

    def nearest(self, name: str) -> NearestBuffers:
        """Return the group of "median" or "front"."""
        group: NearestBuffers = getattr(self, name)
        return group

    @classmethod
    def groups(cls) -> dict[str, type[BufferGroup]]:
        """Return the types of the groups by name."""
        return get_type_hints(cls)

    def allocated(self) -> dict[str, int]:
        """Return the bytes of each allocated buffer, by "group.buffer"."""
        return {
            f"{group}.{name}": size
            for group in self.groups()
            for name, size in getattr(self, group).allocated().items()
        }
