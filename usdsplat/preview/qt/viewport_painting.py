"""Paint a viewport: the picture, overlays and text."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QImage, QPainter

from usdsplat.preview.manipulator import LENGTH, VIEW_RING, Handle, Manipulator
from usdsplat.preview.overlays import LightMark
from usdsplat.preview.projection import Projection
from usdsplat.preview.qt import style
from usdsplat.preview.qt import viewport_figures as figures
from usdsplat.preview.qt import viewport_hud as hud
from usdsplat.preview.qt import viewport_overlays as overlays
from usdsplat.preview.qt.viewport_holds import Rectangle
from usdsplat.preview.qt.viewport_targets import grip_of
from usdsplat.preview.values import Busy, Picture, ViewState

MEMORY = 1.0
"""Time window of the frame rate [s]."""
CORNER = 46.0
"""Distance of the axes from the lower left corner [pixel of the window]."""
BESIDE_AXES = 84.0
BELOW = 20.0
"""Distance of the words of a drag from the handles above them [pixel of the window]."""
PREPARING = "Preparing the first picture…"
ABOVE = 30.0
"""Distance of the names of a comparison from the tags at the bottom [pixel of the window]."""
LIGHTING = "Lighting…"


class Rate:
    """Frame rate while the view moves."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()

    def count(self, now: float) -> None:
        """Count a picture at a time [s]."""
        self._times.append(now)
        while now - self._times[0] > MEMORY:
            self._times.popleft()

    def stop(self) -> None:
        """Reset the rate when the view rests."""
        self._times.clear()

    @property
    def per_second(self) -> float | None:
        """Pictures per second; None before the second picture of a movement."""
        if len(self._times) < 2 or self._times[-1] == self._times[0]:
            return None
        return (len(self._times) - 1) / (self._times[-1] - self._times[0])


@dataclass(slots=True)
class Badges:
    """What is said over the picture, or before the first one."""

    waiting: str = PREPARING
    """What the first picture waits for."""
    progress: str = ""
    """How far the light of the next picture is; "" if it is not known."""
    unsimulated: str = ""
    """That the shown time is not simulated; "" if it is."""

    def follow(self, busy: Busy) -> None:
        """Say what a session does."""
        self.progress = progress_of(busy)
        self.waiting = f"{busy.what[:1].upper()}{busy.what[1:]}…" if busy.what else PREPARING


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """The data of one painted viewport."""

    picture: Picture
    image: QImage
    size: tuple[int, int]
    """Size of the viewport [pixel of the screen]."""
    ratio: float
    """Screen pixels per window pixel."""
    projection: Projection
    state: ViewState
    """What is wanted, of which the selection and the lights are painted at once."""
    lights: Sequence[LightMark]
    """Lights at their places now."""
    side: int
    """Side of a comparison whose name stands out: 0 is left."""
    badges: Badges
    edges: Sequence[QLineF]
    """The edges of meshes."""
    affectors: Sequence[QLineF]
    """The outlines of what acts on simulations."""
    manipulator: Manipulator | None
    hot: Handle | None
    """The handle under the pointer."""
    hot_light: str
    """Path of the light under the pointer; "" for none."""
    wipe: float | None
    """Position of the wipe as a fraction of the width; None for no comparison."""
    wipe_is_hot: bool
    box: Rectangle | None
    """The box that is being drawn; None for none."""
    dragged: str
    """What the drag of a handle has changed so far, in words; "" for no drag."""
    shows_hud: bool
    rate: float | None
    """Pictures per second."""


def progress_of(busy: Busy) -> str:
    """Return how far a part of drawing a picture is, in words; "" for other events."""
    if not busy.of_picture or not busy.what:
        return ""
    part = f" {busy.done}/{busy.total}" if busy.total else ""
    return f"{busy.what[:1].upper()}{busy.what[1:]}…{part}"


def paint_nothing(painter: QPainter, place: QRectF, words: str) -> None:
    """Paint a viewport without a picture, and what it waits for."""
    painter.fillRect(place, style.SUNK)
    painter.setPen(style.OFF)
    painter.drawText(place, Qt.AlignmentFlag.AlignCenter, words)


def paint(painter: QPainter, place: QRectF, scene: Scene) -> None:
    """Paint a viewport, `place` in pixels of the window."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    _paint_image(painter, place, scene)
    painter.save()
    painter.scale(1.0 / scene.ratio, 1.0 / scene.ratio)
    _paint_placed(painter, scene)
    painter.restore()
    _paint_words(painter, place, scene)


def _paint_image(painter: QPainter, place: QRectF, scene: Scene) -> None:
    """Paint the image, scaled to fit if its size differs from the viewport's."""
    if (scene.image.width(), scene.image.height()) == scene.size:
        painter.drawImage(place, scene.image)
        return
    width, height = scene.picture.state.size
    scale = min(place.width() / width, place.height() / height)
    there = QRectF(0.0, 0.0, scale * width, scale * height)
    there.moveCenter(place.center())
    painter.fillRect(place, style.SUNK)
    painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
    painter.drawImage(there, scene.image)


def _paint_placed(painter: QPainter, scene: Scene) -> None:
    """Paint overlays with a position in the picture, in viewport pixels."""
    ratio, (width, height) = scene.ratio, scene.size
    over, selected = scene.picture.overlays, scene.state.selected
    figures.paint_edges(painter, scene.edges, ratio=ratio)
    figures.paint_affectors(painter, scene.affectors, ratio=ratio)
    is_same = scene.picture.state.selected == selected
    boxes = (*over.bounds, *(scene.picture.boxes if is_same else ()))
    overlays.paint_boxes(painter, boxes, scene.projection, ratio=ratio)
    figures.paint_lights(
        painter,
        scene.lights if scene.state.shows_lights else (),
        scene.projection,
        ratio=ratio,
        chosen=selected,
        hot=scene.hot_light,
    )
    if scene.wipe is not None:
        x = scene.wipe * width
        grip = QPointF(*grip_of(x, scene.size, ratio=ratio))
        overlays.paint_wipe(painter, x, height, grip, ratio=ratio, is_hot=scene.wipe_is_hot)
    if scene.manipulator is not None:
        overlays.paint_manipulator(painter, scene.manipulator, scene.projection, hot=scene.hot)
    if scene.box is not None:
        overlays.paint_box(painter, scene.box, ratio=ratio)
    corner = QPointF(CORNER * ratio, height - CORNER * ratio)
    overlays.paint_tripod(painter, scene.projection, corner, ratio=ratio)


def _paint_words(painter: QPainter, place: QRectF, scene: Scene) -> None:
    picture = scene.picture
    right, bottom = place.right() - hud.MARGIN, place.bottom() - hud.MARGIN
    if scene.shows_hud:
        rows = hud.rows_of(picture, rate=scene.rate)
        hud.paint_rows(painter, rows, QPointF(hud.MARGIN, hud.MARGIN))
    hud.paint_tag(painter, hud.camera_name(picture.state), QPointF(BESIDE_AXES, bottom))
    left_name, right_name = hud.look_names(picture.state)
    if scene.wipe is not None and right_name:
        cut, line = scene.wipe * place.width(), bottom - ABOVE
        for side, name in enumerate((left_name, right_name)):
            at = QPointF(cut + (hud.MARGIN if side else -hud.MARGIN), line)
            color = overlays.HOT if side == scene.side else style.TEXT
            hud.paint_tag(painter, name, at, right=not side, color=color)
    else:
        tag = hud.paint_tag(painter, left_name, QPointF(right, bottom), right=True)
        right = tag.left() - 6.0
    if scene.manipulator is not None and scene.dragged:
        hud.paint_label(painter, scene.dragged, _below(scene.manipulator, scene), place)
    middle = QPointF(place.center().x(), hud.MARGIN)
    if scene.badges.unsimulated:
        pane = hud.paint_badge(painter, scene.badges.unsimulated, middle)
        middle.setY(pane.bottom() + hud.GAP)
    if picture.lacks_light:
        hud.paint_badge(painter, scene.badges.progress or LIGHTING, middle)
    if picture.scale > 1.0:
        mark = f"coarse ×{picture.scale:g}"
        hud.paint_tag(painter, mark, QPointF(right, bottom), right=True, color=style.ANIMATED)


def _below(manipulator: Manipulator, scene: Scene) -> QPointF:
    """Return the point below the handles of a manipulator, in pixels of the window."""
    x, y = scene.projection.pixels(manipulator.origin)[0] / scene.ratio
    return QPointF(x, y + VIEW_RING * LENGTH + BELOW)
