"""Estimate how much memory a picture takes before it is drawn.

What is in memory already is read from the system, or counted. What a picture adds is the buffers
that it uses, whose declarations in `frame_buffers` say how large they are. The numbers that those
depend on, such as the number of visible splats, are estimated from a sample of all splats.
`benchmarks/memory.py` compares the result with measured peaks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.images.aovs import AOVS
from usdsplat.kernels import bins, triangles
from usdsplat.render.aov_resolver import AVERAGED, SUMMED
from usdsplat.render.buffers import Buffer, Sizes
from usdsplat.render.draw_list import DrawList, Group
from usdsplat.render.frame_buffers import FrameBuffers, SurfaceBuffers, TriangleBuffers
from usdsplat.render.matte import is_matte
from usdsplat.render.motion import FRAMES
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.settings import RenderSettings
from usdsplat.render.spatial_order import LEAST, MAKING
from usdsplat.render.spatial_order import PER_SPLAT as PER_SPLAT_LAID
from usdsplat.render.specs import MeshSpec, View

MIB = 1 << 20
BASE = 250 * MIB
"""Python and the libraries, where the system does not say what they take."""
KERNELS = 85 * MIB
"""What the kernels take once a picture is drawn that they do not take before."""
PROBES = 100_000
"""Splats that are looked at to estimate how many are seen."""
UNEVEN = 1.5
"""How many more pairs of splat and tile the fullest band has than a band on average."""
DEEP_SAMPLES = 48
"""Of a deep pixel, on average: what a dense capture has where it fills the picture."""
DEEP_SAMPLE = 80
"""Bytes of each: 24 in arrays, the same again beside a surface's, and rows on their way to disk."""
WRITER, WRITER_ROWS = 4, 64
"""Copies and number of the rows that are on their way to a file at a time."""

PARTIAL_PAGES = 2
"""Bytes of a slot: pages of wide rows that are touched for a few rows only."""
RANKS = 8
"""Bytes of a splat that a display mode draws: the ranks that it is taken from."""
VERTEX, BOX = 8 * triangles.VERTEX, 16
"""Bytes of a corner and of a triangle on the screen."""
HOLDOUT_ROWS = 4
"""Bytes of a pixel of a holdout, as it is read."""
PLAIN_VIEW, OCIO_VIEW = 135, 60
"""Bytes of a pixel that goes through a view: straight colours and copies, of float64 or float32."""
IMAGES = {"albedo": "albedo", "Neye": "normals", "depthExpected": "depths"}
"""AOV -> the group of buffers that it is blended in."""
PIXELS = {
    "Neye": "normals",
    "depthExpected": "expected_depth",
    "P": "positions",
    "motionForward": "motion_forward",
    "motionBackward": "motion_backward",
}
"""AOV -> the buffer of `PixelBuffers` that holds it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Bytes that a picture takes, by what for."""

    held: int
    """What is there before: the program, the stage, splats, surfaces and textures."""
    splats: int
    """What is made of each splat and triangle that is seen."""
    band: int
    """Pixels of a band, lists of its tiles, and what is on its way to the file."""
    rows: int
    """Rows of a band."""

    @property
    def total(self) -> int:
        """All of it."""
        return self.held + self.splats + self.band


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureRequest:
    """What is drawn of a view, as far as memory depends on it."""

    aovs: tuple[str, ...] = ("color",)
    """Which of `renderer.AOVS`."""
    holds_out: bool = False
    """Whether there is a holdout from elsewhere."""
    deep: bool = False
    """Whether all contributions are kept."""
    baked: bool = False
    """Whether the pixels go through a view transform once they are drawn."""
    pictures: int = 1
    """How many such pictures are drawn at the same time."""


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
    """Estimate what drawing a picture takes.

    Args:
        request: What is drawn.
        band_pixels: As `Renderer.render` takes it.
        threads: Of the device that draws.
    """
    screen = Screen.of(view)
    x0, y0, x1, y1 = screen.window
    begin, end = next(screen.bands(band_pixels))
    layout = scene.draw_list(settings.splat_budget)
    laid = {id(group.cloud): len(group.cloud) for group in layout.groups}
    pixels, share = (end - begin) * (x1 - x0), min(1.0, UNEVEN * (end - begin) / (y1 - y0))
    sizes = _sizes(scene, layout, screen, (begin, end), share=share, threads=threads)
    used = buffers_of(scene, view, settings, request)
    in_band = sum(each.touched_bytes(sizes) for name, each in used.items() if not _by_splat(name))
    by_splat = sum(each.touched_bytes(sizes) for name, each in used.items() if _by_splat(name))
    by_splat += PARTIAL_PAGES * layout.slots + _of_meshes(scene)
    if "display.records" in used:
        by_splat += RANKS * sizes.visible
    kept = DEEP_SAMPLES * DEEP_SAMPLE if request.deep else 0
    channels = sum(len(aov.channels) for aov in AOVS.values() if aov.hydra in request.aovs)
    writing = WRITER * WRITER_ROWS * (x1 - x0) * 4 * channels
    in_band += pixels * (HOLDOUT_ROWS * request.holds_out + _of_view(settings, request))
    return Estimate(
        held=_held(scene),
        splats=request.pictures * by_splat
        + (PER_SPLAT_LAID + MAKING) * sum(n for n in laid.values() if n >= LEAST),
        band=request.pictures * in_band + pixels * kept + writing,
        rows=end - begin,
    )


def buffers_of(
    scene: RenderScene, view: View, settings: RenderSettings, request: PictureRequest
) -> dict[str, Buffer]:
    """Return the buffers of a frame that a picture uses, by their names in `FrameBuffers`.

    A few may not be used: those for ties, and, if something else holds out, those that either a
    flat or a deep holdout needs.
    """
    layout, meshes = scene.draw_list(settings.splat_budget), bool(scene.drawn_meshes())
    aovs, mode = set(request.aovs), settings.display_mode
    holds = any(is_matte(layout.prims[number], view.matte) for number in set(layout.labels[:, 0]))
    by_ray = settings.sorting == "rayHitDistance"
    walks = by_ray or holds or request.holds_out
    ray_hits, features = meshes or request.holds_out or by_ray, bool(SUMMED & aovs)
    features = features or mode == "normals"
    crypto, moves = "cryptoObject" in aovs, bool(FRAMES.keys() & aovs)
    ellipses, sampled = mode == "ellipses", settings.samples > 1
    images = {"color": bool(aovs)} | {group: name in aovs for name, group in IMAGES.items()}
    nearest = {
        "median": bool(aovs - {*AVERAGED, *SUMMED, "depthFront"}),
        "front": "depthFront" in aovs,
    }
    uses = [
        (True, "splats", "records keys sources found closed visible sort_keys sort_slots"),
        (True, "splats", "histogram ties ordered"),
        (ray_hits, "splats", "ray_hits ordered_ray_hits"),
        (features, "splats", "features ordered_features"),
        (holds, "splats", "keeps"),
        (crypto, "splats", "labels"),
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
        (crypto, "pixels", "prims weights"),
        (crypto and meshes, "pixels", "surface_prims"),
        (bool(aovs) and meshes, "pixels", "left"),
        (request.holds_out and not meshes, "pixels", "holdout_depth holdout_covered"),
        (request.deep, "pixels", "deep_offsets"),
        (meshes, "surfaces", " ".join(SurfaceBuffers.declared())),
        (meshes, "triangles", " ".join(TriangleBuffers.declared())),
        (sampled and "color" in aovs, "sums", "color"),
        (sampled and "albedo" in aovs, "sums", "albedo"),
        (sampled and crypto, "sums", "prims weights mattes"),
        (crypto and not sampled, "pixels", "mattes"),
    ]
    groups = FrameBuffers.groups()
    return {
        f"{group}.{name}": groups[group].declared()[name]
        for is_used, group, names in uses
        if is_used
        for name in names.split()
    }


def fitting(of: Callable[[int], Estimate], most: int, limit: int) -> tuple[int, Estimate]:
    """Return the tallest bands that keep a picture under a limit, and what it takes with them.

    Args:
        of: What the picture takes with bands of so many rows of tiles.
        most: Rows of tiles of a band where there is no limit.
        limit: [byte]. One row of tiles is returned even where that takes more.
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
    """Bytes of this process that are in memory now; 0 where the system does not say."""
    return _said("/proc/self/status", "VmRSS")


def free() -> int:
    """Bytes that programs can still take before others have to give way; 0 where nobody says."""
    return _said("/proc/meminfo", "MemAvailable")


def _said(file: str, name: str) -> int:
    """A size that Linux says in kibibytes, in bytes; 0 where it does not."""
    try:
        text = Path(file).read_text()
    except OSError:
        return 0
    line = next((line for line in text.splitlines() if line.startswith(name)), "none: 0")
    return 1024 * int(line.split()[1])


def _held(scene: RenderScene) -> int:
    """What there is before a picture, and the kernels: as the system says, or counted."""
    now = resident()
    if not now:
        clouds = {id(each.spec.cloud): each.spec.cloud for each in scene.visible_fields()}
        meshes = {id(mesh.spec): mesh.spec for _, mesh, _ in scene.drawn_meshes()}
        now = BASE + sum(map(_nbytes, clouds.values())) + sum(map(_nbytes, meshes.values()))
    return now + KERNELS


def _nbytes(thing: SplatCloud | MeshSpec) -> int:
    """Bytes of all arrays of a value."""
    names = (item.name for item in fields(thing))
    return sum(getattr(getattr(thing, name), "nbytes", 0) for name in names)


def _by_splat(name: str) -> bool:
    """Whether a buffer is as large as the splats are many, not as large as a band."""
    return name.startswith(("splats.", "display."))


def _sizes(
    scene: RenderScene,
    layout: DrawList,
    screen: Screen,
    rows: tuple[int, int],
    *,
    share: float,
    threads: int,
) -> Sizes:
    """Estimate the sizes of the fullest band, in which there is a share of all tiles."""
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
        chunks=4 * threads,
        height=rows[1] - rows[0],
        width=x1 - x0,
        tile_rows=int(grid["rows"]),
        tile_columns=int(grid["columns"]),
        crossings=int(share * crossings),
        pairs=int(share * pairs),
        triangle_pairs=sum(len(mesh.spec.triangles) for _, mesh, _ in scene.drawn_meshes()),
    )


def _of_meshes(scene: RenderScene) -> int:
    """Bytes that are made of the triangles and textures of a scene for a view."""
    drawn = scene.drawn_meshes()
    specs = {id(mesh.spec): mesh.spec for _, mesh, _ in drawn}.values()
    size = sum(VERTEX * len(m.spec.points) + BOX * len(m.spec.triangles) for _, m, _ in drawn)
    size += sum(_nbytes(spec) for spec in specs) if len(specs) > 1 else 0  # laid out side by side
    pictures = {
        id(material.texture.pixels): material.texture.pixels.nbytes
        for spec in specs
        for material in spec.materials
        if material.texture is not None
    }
    return size + sum(pictures.values()) * 4 // 3


def _of_view(settings: RenderSettings, request: PictureRequest) -> int:
    """Bytes of a pixel that goes through a view."""
    if not request.baked and settings.color_mode != "inverseView":
        return 0
    names = (settings.ocio_config, settings.ocio_display, settings.ocio_view, settings.ocio_look)
    return OCIO_VIEW if any(names) else PLAIN_VIEW


def _visible(layout: DrawList, screen: Screen) -> tuple[int, int, int]:
    """Estimate how many splats are visible, and their pairs with rows of tiles and with tiles."""
    step = max(1, layout.splats // PROBES)
    found = np.array([_probed(group, screen, step) for group in layout.groups]).reshape(-1, 3)
    visible, crossings, pairs = found.sum(axis=0).tolist()
    return int(visible), int(crossings), int(pairs)


def _probed(group: Group, screen: Screen, step: int) -> tuple[float, float, float]:
    """`_visible` of one group, from every so many of its splats."""
    cloud = group.cloud
    part = slice(None, None, step)
    matrices = screen.world_to_camera[:3] @ group.transforms
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
    # Mean tiles that an ellipse at a random place touches: area, half its outline, and itself.
    tile = bins.TILE
    touched = 1 + 4 / np.pi * (long + short) / tile + np.pi * long * short / tile**2
    touched = np.minimum(touched, (1 + (x1 - x0) / tile) * (1 + (y1 - y0) / tile))
    # Mean extent of an ellipse along a fixed direction, over all its turns.
    crossed = 1 + 2 * np.sqrt((long**2 + short**2) / 2) / tile
    crossed = np.minimum(crossed, 1 + (y1 - y0) / tile)
    return step * seen.sum(), step * crossed[seen].sum(), step * touched[seen].sum()
