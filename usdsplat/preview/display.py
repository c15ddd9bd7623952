"""Any AOV as 8-bit RGB, the way compositors expect to see it.

Colours go through exposure in linear light, the view and gamma, and lie over the background; depths
go from white to black; normals and positions are coloured by their axes, motion by its direction;
ids have steady colours. The background is seen wherever nothing is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.delegate.default_camera import Box
from usdsplat.delegate.render_buffer import Pixels
from usdsplat.images.aovs import find_aovs
from usdsplat.images.color import REC709, convert, luminance
from usdsplat.kernels import show
from usdsplat.kernels.device import CpuDevice
from usdsplat.preview import palette
from usdsplat.preview.values import DisplaySettings, Image, Look
from usdsplat.preview.viewing import Ways

Mask = npt.NDArray[np.bool_]

CHANNELS = {
    "rgb": show.ALL, "luminance": show.ALL, "red": show.RED, "green": show.GREEN,
    "blue": show.BLUE, "alpha": show.ALPHA,
}  # fmt: skip
BACKGROUNDS = {
    "black": (0.0, 0.0), "grey": (0.22, 0.22), "white": (1.0, 1.0), "checker": (0.28, 0.4),
}  # fmt: skip
"""Code values of the two kinds of squares."""
SQUARE = 12
"""Edge of a square [pixel of the viewport]."""
STRAYS = 1.0
"""Percent of depths at either end that may lie outside of the range that is found."""
KEPT = 0.15
"""By what part of itself a range may differ from what is found while the view moves."""
FEW = 40_000
"""Pixels that are looked at, about, to find a range."""
BESIDE = {"albedo": "color", "motionForward": "depth", "motionBackward": "depth"}
"""What else must be drawn to show an AOV: what says where nothing is."""

LUMINANCE = luminance(REC709)
_LINEAR = convert(np.repeat(np.arange(256)[:, None] / 255, 3, 1), "srgb_rec709_display",
                  "lin_rec709_scene")[:, 0]  # fmt: skip
"""Linear light of each code value."""


def needed(look: Look) -> tuple[str, ...]:
    """Return what must be drawn to show a look, in Hydra's words.

    Raises:
        UsageError: If there is no such AOV.
    """
    name = find_aovs((look.aov,))[0].hydra
    return (name, BESIDE[name]) if name in BESIDE else (name,)


class Display:
    """Makes what was drawn visible. It keeps ranges, so that they are steady while a view moves."""

    def __init__(self, device: CpuDevice) -> None:
        self._device = device
        self._ways = Ways()
        self._ranges: dict[str, tuple[float, float]] = {}

    def image(
        self,
        look: Look,
        arrays: Mapping[str, Pixels],
        display: DisplaySettings,
        *,
        scale: float = 1.0,
        is_moving: bool = False,
        prims: tuple[str, ...] = (),
        subject: Box | None = None,
    ) -> Image:
        """Return what a screen shows, shape (h, w, 3).

        Args:
            look: What is seen.
            arrays: What `needed` names, shape (h, w) or (h, w, channels).
            display: How it is seen.
            scale: Pixels of the viewport to a side of one of the arrays'.
            is_moving: Whether ranges shall stay about as they were.
            prims: Paths that primId counts.
            subject: Box in the world that positions are shown in; None for a unit cube.

        Raises:
            UsageError: If there is no such AOV or OCIO view.
        """
        name = needed(look)[0]
        if name in ("color", "albedo"):
            return self._color(look, _with_alpha(name, arrays), display, scale)
        pixels = arrays[name]
        if name.startswith("depth"):
            shown, there = self._depth(name, pixels, display, is_moving)
        elif name == "Neye":
            shown, there = _half(pixels), _is_any(pixels)
        elif name == "P":
            shown, there = _placed(pixels, subject), _is_any(pixels)
        elif name in ("motionForward", "motionBackward"):
            shown = self._motion(pixels, is_moving)
            there = np.isfinite(arrays[BESIDE[name]])
        elif name == "cryptoObject":
            return self._matte(pixels, display, scale)
        else:
            there = pixels >= 0
            if name == "primId":
                shown = np.take(palette.of_names((*prims, "")), pixels, axis=0)
            else:
                shown = palette.of_ids(pixels)
        return _over(shown, there, background(pixels.shape[:2], display, scale))

    # --- private ---------------------------------------------------------------------------

    def _color(self, look: Look, image: F32, display: DisplaySettings, scale: float) -> Image:
        way = self._ways.of(look.settings, exposure=display.exposure, gamma=display.gamma)
        height, width = image.shape[:2]
        one, two = (np.float32(code) for code in BACKGROUNDS[display.background])
        square = max(1, round(SQUARE / scale))
        is_second = np.arange(width) // square % 2 == 1
        rows = np.where(np.stack([is_second, ~is_second]), two, one)
        out = np.empty((height, width, 3), np.uint8)
        self._device.run(
            show.show, np.ascontiguousarray(image), way.matrix, way.shaper,
            np.float32(1.0 / way.shaper_top), way.cube, way.table, np.float32(1.0 / way.top),
            CHANNELS[display.channel], rows, square, out,
        )  # fmt: skip
        return _grey_of(out) if display.channel == "luminance" else out

    def _depth(
        self, name: str, depths: F32, display: DisplaySettings, is_moving: bool
    ) -> tuple[Image, Mask]:
        there = np.isfinite(depths)
        white, black = display.depth_range
        if white == black:
            white, black = self._range(name, depths, is_moving)
        span = (black - white) or 1.0
        parts = np.where(there, (np.float32(black) - depths) / np.float32(span), np.float32(0))
        return palette.ramp(display.colormap, parts), there

    def _motion(self, motion: F32, is_moving: bool) -> Image:
        x, y = motion[..., 0], motion[..., 1]
        lengths: F32 = np.hypot(x, y)
        most = self._range("motion", lengths[lengths > 0], is_moving)[1]
        return palette.of_directions(x, y, (lengths / np.float32(most or 1.0)).astype(np.float32))

    def _range(self, name: str, values: F32, is_moving: bool) -> tuple[float, float]:
        """Where nearly all values lie; while a view moves it follows slowly."""
        some = values.ravel()[:: max(1, values.size // FEW)]
        some = some[np.isfinite(some)]
        held = self._ranges.get(name)
        if some.size == 0:
            return held or (0.0, 1.0)
        low, high = (float(each) for each in np.percentile(some, (STRAYS, 100 - STRAYS)))
        if is_moving and held is not None:
            most = KEPT * (held[1] - held[0])
            low = min(max(held[0], low - most), low + most)
            high = min(max(held[1], high - most), high + most)
        self._ranges[name] = low, high
        return low, high

    def _matte(self, pixels: F32, display: DisplaySettings, scale: float) -> Image:
        ranks = pixels.reshape(*pixels.shape[:2], -1, 2)
        back = background(pixels.shape[:2], display, scale)
        seen = ranks[..., 1].sum(axis=-1)
        total = np.maximum(np.float32(0), np.float32(1) - seen)[..., None] * back
        for rank in range(ranks.shape[2]):
            weight = ranks[..., rank, 1]
            if not weight.any():
                break
            names = np.ascontiguousarray(ranks[..., rank, 0]).view(np.uint32)
            total = total + palette.of_ids(names) * weight[..., None]
        return np.asarray(np.clip(total + np.float32(0.5), 0, 255).astype(np.uint8))


def background(shape: tuple[int, int], display: DisplaySettings, scale: float) -> Image:
    """What is seen where nothing is, shape (h, w, 3)."""
    one, two = BACKGROUNDS[display.background]
    square = max(1, round(SQUARE / scale))
    rows, columns = (np.arange(length) // square for length in shape)
    codes = np.where((rows[:, None] + columns) & 1, two, one)
    return np.repeat(np.floor(255 * codes + 0.5).astype(np.uint8)[..., None], 3, axis=-1)


def _with_alpha(name: str, arrays: Mapping[str, Pixels]) -> F32:
    """Premultiplied RGBA."""
    if name == "color":
        return arrays[name]
    return np.concatenate([arrays[name], arrays["color"][..., 3:]], axis=-1)


def _grey_of(image: Image) -> Image:
    """The luminance of code values, as a grey of that luminance."""
    light = np.take(_LINEAR.astype(np.float32), image, axis=0) @ LUMINANCE.astype(np.float32)
    middles = 0.5 * (_LINEAR[1:] + _LINEAR[:-1])
    levels = np.searchsorted(middles, light).astype(np.uint8)
    return np.repeat(levels[..., None], 3, axis=-1)


def _half(normals: F32) -> Image:
    """-1 to 1 as 0 to 255."""
    return np.clip(normals * np.float32(127.5) + np.float32(128), 0, 255).astype(np.uint8)


def _placed(positions: F32, subject: Box | None) -> Image:
    """The subject's low corner black, its high corner white."""
    low, high = subject if subject is not None else (np.zeros(3), np.ones(3))
    span = np.where(high > low, high - low, 1.0)
    levels = (positions - low.astype(np.float32)) * (255 / span).astype(np.float32)
    return np.asarray(np.clip(levels + np.float32(0.5), 0, 255).astype(np.uint8))


def _is_any(vectors: F32) -> Mask:
    """Where a vector is not zero."""
    return (vectors[..., 0] != 0) | (vectors[..., 1] != 0) | (vectors[..., 2] != 0)


def _over(shown: Image, there: Mask, back: Image) -> Image:
    return np.where(there[..., None], shown, back)
