"""Estimate how much memory a picture takes before it is drawn.

What is in memory already is read from the system, or counted. What a picture adds is counted array
by array, for each visible splat and for each pixel of a band. The number of visible splats and of
the tiles that they touch is estimated from a sample of all splats.

The bytes are those of `projector`, `tile_lists`, `aov_resolver`, `accumulator`, `surfaces` and
`output`; `benchmarks/memory.py` compares them with measured peaks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import bins, cryptomatte, feature, peak, project, triangles, walk
from usdsplat.render.draw_list import DrawList, Group
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

PER_SLOT = 10
"""Bytes of a splat, seen or not: its key and source, whose pages its neighbours touch."""
PER_SPLAT = 4 * (2 * project.RECORD + 1 + 4)
"""Bytes more of one that is seen: records and ordered records, its place, and sorting."""
VERTEX, BOX = 8 * triangles.VERTEX, 16
"""Bytes of a corner and of a triangle on the screen."""
MEDIAN = 24
"""Bytes of a pixel for the rank, depth and ids of what holds Z."""
MOTION = 32
"""Bytes of a pixel for where in a surface motion is looked up."""
SURFACE = 81
"""Bytes of a pixel of a `SurfaceBand`, its winner and what the splats let through."""
HOLDOUT = 13
"""Bytes of a pixel of a holdout's depth, and what splats let through."""
PLAIN_VIEW, OCIO_VIEW = 135, 60
"""Bytes of a pixel that goes through a view: straight colours and copies, of float64 or float32."""
LISTS = 1
"""Bytes of a pixel for counts and starts of the lists of tiles."""
PER_PIXEL = {
    "color": 16,
    "albedo": 16,
    "Neye": 28,
    "depthExpected": 20,
    "depthFront": MEDIAN,
    "P": 12,
    "motionForward": 8,
    "motionBackward": 8,
    "cryptoObject": 16 * walk.RANKS + 8 * cryptomatte.SLOTS,
}
"""Bytes of a pixel for each AOV, besides the median."""
READ_OFF = {"depth", "P", "primId", "instanceId", "elementId", "motionForward", "motionBackward"}
"""AOVs that need the median."""


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
) -> Estimate:
    """Estimate what drawing a picture takes.

    Args:
        request: What is drawn.
        band_pixels: As `Renderer.render` takes it.
    """
    aovs, pictures = request.aovs, request.pictures
    screen = Screen.of(view)
    x0, y0, x1, y1 = screen.window
    begin, end = next(screen.bands(band_pixels))
    wanted, meshes = set(aovs), bool(scene.drawn_meshes())
    layout = scene.draw_list(settings.splat_budget)
    seen, pairs = _seen(layout, screen)
    laid = {id(group.cloud): len(group.cloud) for group in layout.groups}
    peaks = meshes or request.holds_out or settings.sorting == "rayHitDistance"
    mode = settings.display_mode
    per_splat = _per_splat(wanted, mode, peaks=peaks, labels=bool(view.matte))
    per_pixel = _per_pixel(settings, request, meshes=meshes)
    kept = DEEP_SAMPLES * DEEP_SAMPLE if request.deep else 0
    pixels, share = (end - begin) * (x1 - x0), min(1.0, UNEVEN * (end - begin) / (y1 - y0))
    writing = WRITER * WRITER_ROWS * (x1 - x0) * sum(PER_PIXEL.get(name, 4) for name in aovs)
    return Estimate(
        held=_held(scene),
        splats=pictures * (PER_SLOT * layout.slots + seen * per_splat + _of_meshes(scene))
        + (PER_SPLAT_LAID + MAKING) * sum(n for n in laid.values() if n >= LEAST),
        band=int(pictures * (pixels * per_pixel + 4 * share * pairs)) + pixels * kept + writing,
        rows=end - begin,
    )


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


def _per_splat(wanted: set[str], mode: str, *, peaks: bool, labels: bool) -> int:
    """Bytes that are made of each splat that is seen."""
    featured = mode == "normals" or bool({"Neye", "albedo", "depthExpected"} & wanted)
    rows = 4 * (peak.PEAK * peaks + feature.FEATURES * featured)
    label = 4 * (labels or "cryptoObject" in wanted)
    size = PER_SPLAT + 2 * rows + label
    if mode == "ellipses":  # with their rims each is there twice more
        size += 2 * (4 * project.RECORD + 2 * 4 + rows + label)
    return size


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


def _per_pixel(settings: RenderSettings, request: PictureRequest, *, meshes: bool) -> int:
    """Bytes of one pixel of a band."""
    wanted = set(request.aovs)
    size = PER_PIXEL["color"] + LISTS
    size += sum(PER_PIXEL.get(name, 0) for name in wanted - {"color"})
    size += MEDIAN * bool(READ_OFF & wanted)
    size += MOTION * bool({"motionForward", "motionBackward"} & wanted)
    size += SURFACE * meshes + HOLDOUT * request.holds_out
    if settings.samples > 1:
        size += 16 * ("color" in wanted) + 12 * ("albedo" in wanted)
    if not request.baked and settings.color_mode != "inverseView":
        return size
    names = (settings.ocio_config, settings.ocio_display, settings.ocio_view, settings.ocio_look)
    return size + (OCIO_VIEW if any(names) else PLAIN_VIEW)


def _seen(layout: DrawList, screen: Screen) -> tuple[int, int]:
    """About how many splats are seen, and how many pairs of splat and tile they make."""
    step = max(1, layout.splats // PROBES)
    found = [_probed(group, screen, step) for group in layout.groups]
    return sum(each[0] for each in found), sum(each[1] for each in found)


def _probed(group: Group, screen: Screen, step: int) -> tuple[int, int]:
    """`_seen` of one group, from every so many of its splats."""
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
    return int(step * seen.sum()), int(step * touched[seen].sum())
