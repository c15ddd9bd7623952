"""Estimate the memory that a picture takes, before it is drawn.

Memory that is already in use is read from the system, or counted. A picture adds the buffers that
it uses; their sizes follow from the declarations in `frame_buffers`. The numbers on which
sizes depend, such as the number of visible splats, are estimated from a sample of all splats.
`benchmarks/memory.py` compares the estimate with measured peaks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.system_memory import reported
from usdsplat.images.aovs import find_aovs
from usdsplat.images.cryptomatte import LAYERS, rank_pairs
from usdsplat.images.holdout_nodes import STRIP
from usdsplat.kernels import bins, triangles
from usdsplat.render.aov_resolver import PRODUCT, SUMMED, SURFACE, needs_median
from usdsplat.render.buffers import Buffer, Sizes
from usdsplat.render.deep_memory import deep_bytes
from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.frame import DEEP_PIXELS
from usdsplat.render.frame_buffers import MATTES, FrameBuffers, SurfaceBuffers, TriangleBuffers
from usdsplat.render.lights.memory import lighting_bytes, lighting_uses
from usdsplat.render.lights.needs import LightRequest, with_catchers
from usdsplat.render.matte import is_matte
from usdsplat.render.motion import FRAMES
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.spatial_order import LEAST, MAKING
from usdsplat.render.spatial_order import PER_SPLAT as PER_SPLAT_LAID
from usdsplat.render.specs import MeshSpec, View
from usdsplat.render.splat_normals import working_bytes

MIB = 1 << 20
BASE = 250 * MIB
"""Memory of Python and the libraries, assumed where the system does not report it."""
KERNELS = 85 * MIB
"""Memory that kernels take from the first picture on."""
PROBES = 100_000
"""Number of splats that are tested to estimate how many are visible."""
UNEVEN = 1.5
"""Pairs of splat and tile in the fullest band, relative to the mean of all bands."""
WRITER, WRITER_ROWS = 4, 64
"""Number of copies of the rows that are being written to a file, and number of these rows."""
PARTIAL_PAGES = 2
"""Bytes per slot: pages of wide rows of which only a few rows are touched."""
RANKS = 8
"""Bytes per splat that a display mode draws, for its rank."""
VERTEX, BOX = 8 * triangles.VERTEX, 16
"""Bytes per vertex and per triangle on the screen."""
HOLDOUT_ROWS = 40
"""Bytes per pixel of a holdout that is being read: depth and opacity, offsets and a node."""
HOLDOUT_NODE, STRIP_NODE = 16, 110
"""Bytes per node of a deep holdout: depth and transmittance in strips and joined; and while the
nodes of a strip are computed."""
PLAIN_VIEW, OCIO_VIEW = 135, 60
"""Bytes per pixel of a view transform's colours and copies: float64; float32 with OCIO settings."""
PIXELS = {
    "Neye": "normals",
    "Naxis": "axes",
    "confidence": "confidence",
    "occlusion": "occlusion",
    "shadow": "shadow",
    "irradiance": "irradiance",
    "depthExpected": "expected_depth",
    "P": "positions",
    "motionForward": "motion_forward",
    "motionBackward": "motion_backward",
}
"""AOV -> the buffer of `PixelBuffers` that holds it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Bytes that a picture takes, by purpose."""

    held: int
    """Memory in use before the picture: the program, the stage, splats, surfaces and textures."""
    splats: int
    """Buffers for the visible splats and triangles."""
    band: int
    """Pixels of a band, its tile lists, and rows that are being written."""
    rows: int
    """Rows of a band."""
    kept: int = 0
    """Pixels of all bands, of a tile that is written at its end."""

    @property
    def total(self) -> int:
        """The sum of all parts."""
        return self.held + self.splats + self.band + self.kept


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureRequest:
    """The properties of a requested picture that its memory depends on."""

    aovs: tuple[str, ...] = ("color",)
    """Names in `renderer.AOVS`, or of AOVs of light groups."""
    holds_out: bool = False
    """Whether there is an external holdout."""
    held_nodes: float = 0.0
    """Mean number of nodes in a pixel of a deep holdout, see `images.holdout_nodes`."""
    deep: bool = False
    """Whether all contributions are kept."""
    deep_ids: int = 0
    """Number of ids of each deep sample."""
    baked: bool = False
    """Whether a view transform is applied to the drawn pixels."""
    pictures: int = 1
    """Number of such pictures drawn at the same time."""


COLOR_ALONE = PictureRequest()


def estimate(
    scene: RenderScene,
    view: View,
    settings: RenderSettings,
    request: PictureRequest,
    *,
    band_pixels: int,
    threads: int,
) -> Estimate:
    """Estimate the memory of a picture.

    Args:
        request: The picture.
        band_pixels: See `Renderer.render`.
        threads: Threads of the device that draws.
    """
    screen = Screen.of(view)
    x0, y0, x1, y1 = screen.window
    begin, end = _highest(screen.bands(band_pixels))
    layout = scene.draw_list(settings.splat_budget)
    laid = {id(group.cloud): len(group.cloud) for group in layout.groups}
    pixels, share = (end - begin) * (x1 - x0), min(1.0, UNEVEN * (end - begin) / (y1 - y0))
    sizes = _sizes(scene, settings, screen, (begin, end), share=share, threads=threads)
    sizes = replace(sizes, light_parts=len(LightRequest.of(request.aovs).parts))
    used = buffers_of(scene, view, settings, request)
    in_band = sum(each.touched_bytes(sizes) for name, each in used.items() if not _by_splat(name))
    by_splat = sum(each.touched_bytes(sizes) for name, each in used.items() if _by_splat(name))
    receivers, maps = lighting_bytes(scene, view, settings, set(request.aovs))
    by_splat += PARTIAL_PAGES * layout.slots + _of_meshes(scene) + receivers + maps
    if receivers or SURFACE & set(request.aovs):
        missing = (field for field in scene.visible_fields() if field.surface is None)
        by_splat += working_bytes([len(field.spec.cloud) for field in missing])
    by_splat += RANKS * sizes.visible * ("display.records" in used)
    kept = 0
    if request.deep:
        top, bottom = _highest(screen.bands(min(band_pixels, DEEP_PIXELS)))
        kept = (bottom - top) * (x1 - x0) * deep_bytes(settings, request.deep_ids)
    written = find_aovs(request.aovs) if request.aovs else ()
    channels = sum(len(aov.with_rank(settings.crypto_rank).channels) for aov in written)
    writing = WRITER * WRITER_ROWS * (x1 - x0) * 4 * channels
    strip = min(end - begin, STRIP) * (x1 - x0)
    in_band += int(request.held_nodes * (pixels * HOLDOUT_NODE + strip * STRIP_NODE))
    in_band += pixels * (HOLDOUT_ROWS * request.holds_out + _of_view(settings, request))
    return Estimate(
        held=_held(scene),
        splats=request.pictures * by_splat
        + (PER_SPLAT_LAID + MAKING) * sum(n for n in laid.values() if n >= LEAST),
        band=request.pictures * in_band + kept + writing,
        rows=end - begin,
    )


def buffers_of(
    scene: RenderScene, view: View, settings: RenderSettings, request: PictureRequest
) -> dict[str, Buffer]:
    """Return the buffers of a frame that a picture uses, by their names in `FrameBuffers`.

    The result may contain a few that are not used: those for ties and, with an external holdout,
    those for the other kind of holdout, flat or deep.
    """
    layout, meshes = scene.draw_list(settings.splat_budget), bool(scene.drawn_meshes())
    aovs, mode = set(request.aovs), settings.display_mode
    view = with_catchers(scene, view)
    holds = any(is_matte(layout.prims[number], view.matte) for number in set(layout.labels[:, 0]))
    by_ray = settings.sorting == "rayHitDistance"
    walks = by_ray or holds or request.holds_out
    ray_hits, features = meshes or request.holds_out or by_ray, bool(SUMMED & aovs)
    features = features or mode == "normals"
    layers = [layer for layer in LAYERS if layer in aovs]
    crypto, moves = bool(layers), bool(FRAMES.keys() & aovs)
    ellipses, sampled = mode == "ellipses", settings.samples > 1
    images = {"color": bool(aovs)} | {PRODUCT[name]: True for name in SUMMED & aovs}
    nearest = {"median": needs_median(aovs), "front": "depthFront" in aovs}
    uses = [
        (True, "splats", "records keys sources found closed visible sort_keys sort_slots"),
        (True, "splats", "histogram ties ordered"),
        (ray_hits, "splats", "ray_hits ordered_ray_hits"),
        (features, "splats", "features ordered_features"),
        (holds, "splats", "keeps"),
        (crypto, "splats", "labels groups"),
        (ellipses, "display", "opaque records order"),
        (ellipses and ray_hits, "display", "ray_hits"),
        (ellipses and features, "display", "features"),
        (ellipses and holds, "display", "keeps"),
        (ellipses and crypto, "display", "labels"),
        (True, "tiles", "row_places row_ends crossings counts starts lists"),
        (bool(aovs) and not walks, "tiles", "work"),
        *((is_used, group, "image") for group, is_used in images.items()),
        (walks and bool(aovs), "color", "through"),
        *((is_used, group, "ranks depth ids") for group, is_used in nearest.items()),
        *((is_used and walks, group, "ray_depths") for group, is_used in nearest.items()),
        *((name in aovs, "pixels", buffer) for name, buffer in PIXELS.items()),
        (moves and meshes, "pixels", "motion_rows motion_elements motion_weights"),
        *((True, MATTES[layer], "prims weights ranked") for layer in layers),
        *((meshes, MATTES[layer], "surfaces") for layer in layers),
        *((sampled, MATTES[layer], "all_prims all_weights") for layer in layers),
        (bool(aovs) and meshes, "pixels", "left"),
        (request.holds_out and not meshes, "pixels", "holdout_depth holdout_covered"),
        (request.deep, "pixels", "deep_offsets"),
        (request.deep_ids > 0, "splats", "numbered"),
        (meshes, "surfaces", " ".join(SurfaceBuffers.declared())),
        (meshes, "triangles", " ".join(TriangleBuffers.declared())),
        *((sampled and name in aovs, "sums", name) for name in ("color", "albedo")),
        *lighting_uses(scene, view, settings, aovs),
    ]
    groups = FrameBuffers.groups()
    return {
        f"{group}.{name}": groups[group].declared()[name]
        for is_used, group, names in uses
        if is_used
        for name in names.split()
    }


def fitting(of: Callable[[int], Estimate], most: int, limit: int) -> tuple[int, Estimate]:
    """Return the largest band height that keeps a picture under a limit, and the estimate for it.

    Args:
        of: Returns the estimate for bands of a number of rows of tiles.
        most: Rows of tiles of a band without a limit.
        limit: Maximum memory [byte]. One row of tiles is returned even if it takes more.
    """
    found = of(most)
    if found.total <= limit:
        return most, found
    low, high, found = 1, most, of(1)
    while high - low > 1:
        middle = (low + high) // 2
        tried = of(middle)
        if tried.total <= limit:
            low, found = middle, tried
        else:
            high = middle
    return low, found


def resident() -> int:
    """Return the resident bytes of this process; 0 if the system does not report them."""
    return reported(Path("/proc/self/status"), "VmRSS")


def _highest(bands: Iterable[tuple[int, int]]) -> tuple[int, int]:
    """Return the band with the most rows; the first one may begin within a row of tiles."""
    return max(bands, key=lambda rows: rows[1] - rows[0])


def _held(scene: RenderScene) -> int:
    """Return the memory in use before a picture, as reported or counted, plus the kernels."""
    now = resident()
    if not now:
        clouds = {id(each.spec.cloud): each.spec.cloud for each in scene.visible_fields()}
        meshes = {id(mesh.spec): mesh.spec for _, mesh, _ in scene.drawn_meshes()}
        now = BASE + sum(map(_nbytes, clouds.values())) + sum(map(_nbytes, meshes.values()))
    return now + KERNELS


def _nbytes(thing: SplatCloud | MeshSpec) -> int:
    """Return the bytes of all arrays of a value."""
    names = (item.name for item in fields(thing))
    return sum(getattr(getattr(thing, name), "nbytes", 0) for name in names)


def _by_splat(name: str) -> bool:
    """Return whether the size of a buffer depends on the number of splats, not on the band."""
    return name.startswith(("splats.", "display."))


def _sizes(
    scene: RenderScene,
    settings: RenderSettings,
    screen: Screen,
    rows: tuple[int, int],
    *,
    share: float,
    threads: int,
) -> Sizes:
    """Estimate the sizes for the fullest band, which contains a `share` of all tiles."""
    layout = scene.draw_list(settings.splat_budget)
    x0, _, x1, _ = screen.window
    visible, crossings, pairs = _visible(layout, screen)
    grid = bins.grid_of(x0, rows[0], x1, rows[1])[0]
    large = (g for g in layout.groups if len(g.cloud) >= LEAST)
    return Sizes(
        slots=layout.slots,
        blocks=len(layout.block_starts),
        boxes=max((g.all_blocks for g in large), default=0),
        visible=visible,
        shown=2 * visible,
        drawn=2 * visible if settings.display_mode == "ellipses" else visible,
        chunks=4 * threads,
        height=rows[1] - rows[0],
        width=x1 - x0,
        tile_rows=int(grid["rows"]),
        tile_columns=int(grid["columns"]),
        crossings=int(share * crossings),
        pairs=int(share * pairs),
        rank_pairs=rank_pairs(settings.crypto_rank),
        triangle_pairs=sum(len(mesh.spec.triangles) for _, mesh, _ in scene.drawn_meshes()),
    )


def _of_meshes(scene: RenderScene) -> int:
    """Return the bytes that a view needs for the triangles and textures of a scene."""
    drawn = scene.drawn_meshes()
    specs = {id(mesh.spec): mesh.spec for _, mesh, _ in drawn}.values()
    size = sum(VERTEX * len(m.spec.points) + BOX * len(m.spec.triangles) for _, m, _ in drawn)
    size += sum(_nbytes(spec) for spec in specs) if len(specs) > 1 else 0  # copied into one array
    pictures = {
        id(material.texture.pixels): material.texture.pixels.nbytes
        for spec in specs
        for material in spec.materials
        if material.texture is not None
    }
    return size + sum(pictures.values()) * 4 // 3


def _of_view(settings: RenderSettings, request: PictureRequest) -> int:
    """Return the bytes per pixel for the view transform."""
    if not request.baked and settings.color_mode != "inverseView":
        return 0
    names = (settings.ocio_config, settings.ocio_display, settings.ocio_view, settings.ocio_look)
    return OCIO_VIEW if any(names) else PLAIN_VIEW


def _visible(layout: DrawList, screen: Screen) -> tuple[int, int, int]:
    """Estimate the number of visible splats, and of their pairs with rows of tiles and with
    tiles."""
    step = max(1, layout.splats // PROBES)
    found = np.array([_probed(group, screen, step) for group in layout.groups]).reshape(-1, 3)
    visible, crossings, pairs = found.sum(axis=0).tolist()
    return int(visible), int(crossings), int(pairs)


def _probed(group: Group, screen: Screen, step: int) -> tuple[float, float, float]:
    """Return the estimate of `_visible` for one group, from every `step`-th of its splats."""
    cloud = group.cloud
    part = slice(None, None, step)
    matrices = screen.world_to_camera[:3] @ group.placements.transforms
    points = cloud.positions[part].astype(np.float64)
    x, y, z = np.moveaxis(
        np.einsum("mij,nj->mni", matrices[:, :, :3], points) + matrices[:, None, :, 3], 2, 0
    )
    near, far = screen.clipping_range
    depth = np.ones_like(z) if screen.orthographic else np.maximum(z, near)
    (fx, fy), (cx, cy), (x0, y0, x1, y1) = screen.focal, screen.center, screen.window
    size = np.cbrt(np.abs(np.linalg.det(matrices[:, :, :3])))[:, None]
    reach = np.sqrt(2 * np.log(np.maximum(255 * cloud.opacities[part].astype(np.float64), 1)))
    widest = np.sort(cloud.scales[part].astype(np.float64), axis=1)[:, :0:-1]
    long, short = (
        reach * np.sqrt((max(fx, fy) * size / depth * widest[:, i]) ** 2 + screen.low_pass)
        for i in (0, 1)
    )
    u, v = fx * x / depth + cx, fy * y / depth + cy
    seen = (z > near) & (z < far) & (reach > 0)
    seen &= (u + long > x0) & (u - long < x1) & (v + long > y0) & (v - long < y1)
    # Mean tiles that an ellipse at a random place touches: from area and perimeter, plus one.
    tile = bins.TILE
    touched = 1 + 4 / np.pi * (long + short) / tile + np.pi * long * short / tile**2
    touched = np.minimum(touched, (1 + (x1 - x0) / tile) * (1 + (y1 - y0) / tile))
    # Mean extent of an ellipse along a fixed direction, over all rotations.
    crossed = 1 + 2 * np.sqrt((long**2 + short**2) / 2) / tile
    crossed = np.minimum(crossed, 1 + (y1 - y0) / tile)
    return step * seen.sum(), step * crossed[seen].sum(), step * touched[seen].sum()
