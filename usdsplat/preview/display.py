"""Convert AOVs to 8-bit RGB for display, with the conventions of compositors.

Colours get exposure in linear light, the view and gamma, and lie over the background. Depths are
white (near) to black; normals and positions are coloured by axis, motion by direction; ids have
constant colours. The background shows in empty pixels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.delegate.render_buffer import Pixels
from usdsplat.images.aovs import AOVS, Aov, aov_named, find_aovs, is_light
from usdsplat.images.color import REC709, convert, luminance
from usdsplat.images.cryptomatte import LAYERS
from usdsplat.kernels import false_color, show
from usdsplat.kernels.device import Device
from usdsplat.preview import palette
from usdsplat.preview.tree_levels import Levels
from usdsplat.preview.values import DisplaySettings, Image, Look
from usdsplat.preview.viewing import DisplayTransforms
from usdsplat.render.fields import Box
from usdsplat.render.settings import RenderSettings

CHANNELS = {
    "rgb": show.ALL, "luminance": show.ALL, "red": show.RED, "green": show.GREEN,
    "blue": show.BLUE, "alpha": show.ALPHA,
}  # fmt: skip
BACKGROUNDS = {
    "black": (0.0, 0.0), "grey": (0.22, 0.22), "white": (1.0, 1.0), "checker": (0.28, 0.4),
}  # fmt: skip
"""Code values of the two kinds of squares, by background."""
SQUARE = 12
"""Size of a square [pixel of the viewport]."""
STRAYS = 1.0
"""Percentage of depths at each end that may lie outside the automatic range."""
KEPT = 0.15
"""Relative change of the automatic range that is ignored while the view moves."""
FEW = 40_000
"""Approximate number of pixels used to find a range."""
BESIDE = {
    "albedo": "color",
    "irradiance": "color",
    "motionForward": "depth",
    "motionBackward": "depth",
    "confidence": "depth",
    "occlusion": "depth",
    "elementId": "primId",
}
"""AOVs that are also needed to show an AOV, because they mark empty pixels or tell trees apart."""

LUMINANCE = luminance(REC709)
_LINEAR = convert(np.repeat(np.arange(256)[:, None] / 255, 3, 1), "srgb_rec709_display",
                  "lin_rec709_scene")[:, 0]  # fmt: skip
"""Linear light of each code value."""


def needed(look: Look) -> tuple[str, ...]:
    """Return the AOVs needed to show a look, by Hydra's names.

    Raises:
        UsageError: If the AOV is unknown.
    """
    name = find_aovs((look.aov,))[0].hydra
    beside = "color" if is_light(name) else BESIDE.get(name)
    return (name, beside) if beside else (name,)


def choices(lights: tuple[str, ...]) -> tuple[Aov, ...]:
    """Return the AOVs that can be shown of a stage with these AOVs of light groups."""
    return *AOVS.values(), *map(aov_named, lights)


def settings_of(look: Look) -> RenderSettings:
    """Return the settings by which a look is drawn: light is linear."""
    if look.aov == "irradiance" or is_light(look.aov):
        return replace(look.settings, blend_space="linear", color_mode="scene")
    return look.settings


class Display:
    """Converter of AOVs to images; it keeps value ranges, so that they are steady while a view
    moves."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._transforms = DisplayTransforms()
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
        levels: Levels | None = None,
    ) -> Image:
        """Return the displayed image, shape (h, w, 3).

        Args:
            look: AOV and render settings.
            arrays: The AOVs of `needed`, shape (h, w) or (h, w, channels).
            display: Display settings.
            scale: Viewport pixels per side of an array's pixel.
            is_moving: Whether to keep value ranges nearly constant.
            prims: Paths of the prims by primId.
            levels: Levels of splat trees, to colour elements by them.
            subject: World-space box of displayed positions; None for a unit cube.

        Raises:
            UsageError: If the AOV or the OCIO view is unknown.
        """
        name = needed(look)[0]
        if name in ("color", "albedo", "irradiance") or is_light(name):
            return self._color(settings_of(look), _with_alpha(name, arrays), display, scale)
        pixels, out = arrays[name], np.empty((*arrays[name].shape[:2], 3), np.uint8)
        end = (*self._background(out, display, scale), out)
        run = self._device.run
        if name.startswith("depth"):
            white, black = self._depth_range(name, pixels, display, is_moving)
            per_unit = np.float32(1.0 / ((black - white) or 1.0))
            ramp = palette.RAMPS[display.colormap]
            run(false_color.depths, pixels, np.float32(white), per_unit, ramp, *end)
        elif name in ("Neye", "Naxis"):
            run(false_color.vectors, pixels, *_per_axis(np.full(3, -1.0), np.full(3, 1.0)), *end)
        elif name in ("confidence", "occlusion"):
            ramp = palette.RAMPS[display.colormap]
            run(false_color.fractions, pixels, arrays[BESIDE[name]], ramp, *end)
        elif name == "shadow":
            run(false_color.vectors, pixels, *_per_axis(np.zeros(3), np.ones(3)), *end)
        elif name == "P":
            low, high = subject if subject is not None else (np.zeros(3), np.ones(3))
            run(false_color.vectors, pixels, *_per_axis(low, high), *end)
        elif name in ("motionForward", "motionBackward"):
            most = self._longest(pixels, is_moving)
            hues, depth = palette.HUES, arrays[BESIDE[name]]
            run(false_color.motions, pixels, depth, np.float32(1.0 / most), hues, *end)
        elif name in LAYERS:
            pairs = np.ascontiguousarray(pixels).reshape(*pixels.shape[:2], -1, 2)
            run(false_color.mattes, pairs, palette.SHIFT, palette.COLORS, *end)
        elif name == "elementId" and levels is not None:
            found = levels.at(arrays["primId"], pixels, prims)
            run(false_color.counted, found, levels.colors, *end)
        elif name == "primId":
            run(false_color.counted, pixels, palette.of_names(prims), *end)
        else:
            run(false_color.hashed, pixels, palette.SHIFT, palette.COLORS, *end)
        return out

    # --- private ---------------------------------------------------------------------------

    def _color(
        self, settings: RenderSettings, image: F32, display: DisplaySettings, scale: float
    ) -> Image:
        transform = self._transforms.of(settings, exposure=display.exposure, gamma=display.gamma)
        out = np.empty((*image.shape[:2], 3), np.uint8)
        rows, square = _rows(image.shape[1], display, scale)
        self._device.run(
            show.show, np.ascontiguousarray(image),
            transform.matrix, transform.shaper, np.float32(1.0 / transform.shaper_top),
            transform.cube, transform.table, np.float32(1.0 / transform.top),
            CHANNELS[display.channel], rows, square, out,
        )  # fmt: skip
        return _grey_of(out) if display.channel == "luminance" else out

    def _background(self, out: Image, display: DisplaySettings, scale: float) -> tuple[Image, int]:
        """Return two kinds of background rows, and the number of consecutive rows of each."""
        rows, square = _rows(out.shape[1], display, scale)
        codes = np.floor(255 * rows + 0.5).astype(np.uint8)
        return np.repeat(codes[..., None], 3, axis=-1), square

    def _depth_range(
        self, name: str, depths: F32, display: DisplaySettings, is_moving: bool
    ) -> tuple[float, float]:
        """Return the depths that are displayed white and black."""
        white, black = display.depth_range
        return (white, black) if white != black else self._range(name, depths, is_moving)

    def _longest(self, motion: F32, is_moving: bool) -> float:
        """Return the length of motion with the highest brightness [pixel of the picture]."""
        few = motion[:: max(1, math.isqrt(motion[..., 0].size // FEW))]
        return max(self._range("motion", np.hypot(few[..., 0], few[..., 1]), is_moving)[1], 1.0)

    def _range(self, name: str, values: F32, is_moving: bool) -> tuple[float, float]:
        """Return the range of nearly all values; it follows slowly while a view moves."""
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


def _rows(width: int, display: DisplaySettings, scale: float) -> tuple[F32, int]:
    """Return code values of two kinds of background rows, and the number of rows of each."""
    one, two = BACKGROUNDS[display.background]
    square = max(1, round(SQUARE / scale))
    is_second = np.arange(width) // square % 2 == 1
    return np.where(np.stack([is_second, ~is_second]), two, one).astype(np.float32), square


def _per_axis(low: F64, high: F64) -> tuple[F32, F32]:
    """Return the black level on each axis, and the increase per unit."""
    span = np.where(high > low, high - low, 1.0)
    return low.astype(np.float32), (1.0 / span).astype(np.float32)


def _with_alpha(name: str, arrays: Mapping[str, Pixels]) -> F32:
    """Return premultiplied RGBA."""
    if name == "color":
        return arrays[name]
    alpha = arrays["color"][..., 3:]
    colors = arrays[name] * alpha if name == "irradiance" else arrays[name]
    return np.concatenate([colors, alpha], axis=-1)


def _grey_of(image: Image) -> Image:
    """Return greys with the luminance of code values."""
    light = np.take(_LINEAR.astype(np.float32), image, axis=0) @ LUMINANCE.astype(np.float32)
    middles = 0.5 * (_LINEAR[1:] + _LINEAR[:-1])
    levels = np.searchsorted(middles, light).astype(np.uint8)
    return np.repeat(levels[..., None], 3, axis=-1)
