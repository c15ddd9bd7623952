"""Read the camera of a page from a stage, with its animation, in the viewer's coordinates.

The viewer's world is right-handed with y up. It turns captures by 180 degrees about z, so that
those with axes "rdf" are upright. Its field of view is that of the longer side.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.axes import change
from usdsplat.core.cloud import F64
from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Finding, finding
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.product import ProductSpec
from usdsplat.delegate.scene_delegate.cameras import read_camera
from usdsplat.images.background import (
    TRANSPARENT,
    Background,
    background_source,
    parse_background,
)
from usdsplat.interchange.placement import stage_frame
from usdsplat.interchange.unapplied import RELIGHT
from usdsplat.products.planning import find_camera
from usdsplat.products.request import MOST_PIXELS
from usdsplat.render.framing import conform
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing
from usdsplat.render.subject import FILL, of_box

AXES = "rdf"
"""Axes of the captures in pages."""
TURN = np.diag([-1.0, -1.0, 1.0])
"""Rotation from a capture to the viewer's world."""
MOST_KEYS = 10_000
"""Maximum number of frames of an animation, which the page holds as text."""
USUAL_RATE = 24.0
"""Rate of a stage that states an impossible one: USD's default [1/s]."""
FOV_OF_PARALLEL = math.radians(10)
"""Field of view that replaces an orthographic projection [radian]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageRequest:
    """The camera of a page, what is shown, and its title."""

    camera: str | None = None
    """Path of a camera, or its name if it is unique; None is the one that `render` uses."""
    resolution: tuple[int, int] | None = None
    """Width and height of the picture that the page shows at least [pixel]; None is that of the
    stage's first product, or 1920 x 1080."""
    frames: tuple[float, ...] | None = None
    """Time codes of the camera's animation, ascending; None is the range of the stage."""
    purposes: tuple[str, ...] = ("default", "render")
    """Purposes of the prims that are shown."""
    title: str = ""
    """Title of the page; "" is the names of the files."""
    background: str | None = None
    """Colour behind the splats, as for `RenderSettings.background`; None is that of the stage's
    first product. Black where pictures are transparent, grey for a capture by itself."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PageCamera:
    """A camera in the viewer's coordinates, at each frame of its animation."""

    path: str
    """Path of the prim; "" for an automatic camera."""
    frames: tuple[float, ...]
    """Time codes; one if the camera does not move."""
    rate: float
    """Time codes per second."""
    aspect: float
    """Width over height of what is visible in windows of any shape: the picture, or of an automatic
    camera the part of it with the subject."""
    positions: F64
    """Shape (n, 3)."""
    targets: F64
    """Points ahead, as far away as the middle of the subject; shape (n, 3)."""
    ups: F64
    """Unit vectors, shape (n, 3)."""
    fovs: F64
    """Field of view of the longer side of what is visible [degree], shape (n,)."""
    background: Background
    start: int
    """Index of the frame of the splats, or of the nearest."""
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Those on the product whose picture the page shows."""


def page_camera(
    stage: Usd.Stage, request: PageRequest, time: float | None, *, is_capture: bool = False
) -> PageCamera:
    """Return the camera of a page.

    Args:
        stage: The stage, which is not changed.
        request: The camera.
        time: Time code of the splats; None for USD's default time.
        is_capture: Whether the stage is a capture by itself.

    Raises:
        StageError: If there is no such camera, or it forms no image.
        UsageError: If the resolution, the frames or the background are invalid.
    """
    for side in request.resolution or ():
        if side > MOST_PIXELS:
            raise UsageError("--resolution", str(side), f"at most {MOST_PIXELS} pixels on a side")
    with Engine(stage, time=time) as engine:
        path, framing, text, findings = _chosen(engine, request)
        engine.set_purposes(request.purposes)
        where = background_source(is_requested=request.background is not None)
        auto = "grey" if is_capture else TRANSPARENT
        background = parse_background(text, auto=auto, where=where)
        spec = engine.view(path, framing=framing).camera
        subject = engine.render_scene.seen() or of_box((np.full(3, -0.5), np.full(3, 0.5)))
        rate = engine.stage_info().time_codes_per_second
    frames: tuple[float, ...] = (time or 0.0,)
    specs = [spec]
    if path is not None:
        moving = _frames(stage, request.frames, frames)
        found = list(_specs(stage, path, moving))
        if any(each != found[0] for each in found) or request.frames is not None:
            frames, specs = moving, found
    directions, position = _pose(spec)
    middle, half = subject.extent(directions)
    aspect = framing.aspect
    if path is None:
        width = subject.half_width(directions, position) / FILL
        aspect = min(aspect, width / spec.window[3]) or aspect
    eye = _Eye(
        matrix=TURN @ change(stage_frame(stage), AXES),
        middle=middle,
        nearest=max(0.1 * float(half.max()), 1e-3),
        framing=framing,
        aspect=aspect,
    )
    for each in specs:
        eye.add(each)
    return PageCamera(
        path=path or "",
        frames=frames,
        rate=rate if 0 < rate < math.inf else USUAL_RATE,
        aspect=aspect,
        positions=np.array(eye.positions),
        targets=np.array(eye.targets),
        ups=np.array(eye.ups),
        fovs=np.array(eye.fovs),
        background=background or (0.0, 0.0, 0.0),
        start=int(np.argmin(np.abs(np.array(frames) - (time or 0.0)))),
        notes=tuple(eye.notes),
        findings=findings,
    )


def _chosen(
    engine: Engine, request: PageRequest
) -> tuple[str | None, Framing, str, tuple[Finding, ...]]:
    """Return the camera, the picture and the background of what `render` draws: those of the first
    product, else the first camera, else an automatic one; and findings on this product."""
    path = None if request.camera is None else find_camera(engine, request.camera)
    framing = Framing(resolution=request.resolution or Framing().resolution)
    background, findings = RenderSettings().background, tuple[Finding, ...]()
    for product in engine.products(resolution=request.resolution, camera=path)[:1]:
        framing, background = product.framing, product.settings.background
        if path is None and product.camera in engine.cameras():
            path = product.camera
        findings = tuple(_unlit(product))
    text = background if request.background is None else request.background
    return path or next(iter(engine.cameras()), None), framing, text, findings


def _unlit(product: ProductSpec) -> Iterator[Finding]:
    """Yield a finding if the picture of a product has shadows or is relit."""
    modes = {mode for mode, rules in product.light_rules if rules}
    asked = sorted({product.settings.lighting, *modes} - {"captured"})
    if asked:
        expected = "captured: a page has neither lights nor shadows"
        found = f"{' and '.join(asked)} lighting"
        yield finding("not-applied", product.path, found, expected, cure=RELIGHT)


def _frames(
    stage: Usd.Stage, asked: Sequence[float] | None, still: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the frames of an animation; `still` for a stage without a range.

    Raises:
        UsageError: If there are too many.
    """
    if asked is None and not stage.HasAuthoredTimeCodeRange():
        return still
    if asked is None:
        first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        span = last - first + 1e-6
        if not 0 <= span < MOST_KEYS:  # false for infinities too
            found = f"time codes {first:g} to {last:g}"
            expected = f"1 to {MOST_KEYS} frames, or --frames that says which"
            raise UsageError(stage.GetRootLayer().identifier, found, expected)
        return tuple(first + i for i in range(int(span) + 1))
    if len(asked) > MOST_KEYS:
        raise UsageError("--frames", f"{len(asked)} frames", f"at most {MOST_KEYS}")
    return tuple(sorted(set(asked)))


def _specs(stage: Usd.Stage, path: str, frames: Sequence[float]) -> Iterator[CameraSpec]:
    """Yield the camera at each frame."""
    prim = stage.GetPrimAtPath(path)
    for frame in frames:
        yield read_camera(prim, Usd.TimeCode(frame), UsdGeom.XformCache(frame))


def _pose(spec: CameraSpec) -> tuple[F64, F64]:
    """Return the directions of a camera, rows right, up and back, and its position."""
    to_world = np.linalg.inv(np.reshape(spec.world_to_camera, (4, 4)))
    axes = to_world[:3, :3] / np.linalg.norm(to_world[:3, :3], axis=0)
    return axes.T, to_world[:3, 3]


@dataclass(slots=True, eq=False, kw_only=True)
class _Eye:
    """Poses of a camera in the viewer's coordinates."""

    matrix: F64
    """Rotation from the stage, shape (3, 3)."""
    middle: F64
    """Middle of the subject, in the stage's coordinates, shape (3,)."""
    nearest: float
    """Least distance of the target [scene unit]."""
    framing: Framing
    aspect: float
    """See `PageCamera`."""
    positions: list[F64] = field(default_factory=list)
    targets: list[F64] = field(default_factory=list)
    ups: list[F64] = field(default_factory=list)
    fovs: list[float] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)

    def add(self, spec: CameraSpec) -> None:
        """Add the pose of a camera, and notes on what the viewer cannot show."""
        (_, up, back), position = _pose(spec)
        depth = max(float((self.middle - position) @ -back), self.nearest)
        target = position - depth * back
        (left, bottom, right, top), pixel_aspect = conform(spec.window, self.framing)
        middle = max(abs(left + right), abs(bottom + top))
        if middle > 1e-3 * (right - left):
            self.notes["the viewer centres the picture on the axis of the camera"] = None
        if pixel_aspect != 1.0:
            self.notes["the viewer has square pixels"] = None
        longer = (top - bottom) * max(self.aspect, 1.0)
        if spec.orthographic:
            said = f"{math.degrees(FOV_OF_PARALLEL):g} degrees"
            self.notes[f"the viewer has no parallel projection: perspective of {said}"] = None
            position = target + back * 0.5 * longer / math.tan(0.5 * FOV_OF_PARALLEL)
            fov = FOV_OF_PARALLEL
        else:
            fov = 2 * math.atan(0.5 * longer)
        self.positions.append(self.matrix @ position)
        self.targets.append(self.matrix @ target)
        self.ups.append(self.matrix @ up)
        self.fovs.append(math.degrees(fov))
