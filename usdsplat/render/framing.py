"""Fit a camera's aperture to an image: conform the aspect ratio, crop and overscan.

Windows are (left, bottom, right, top) with y up, in the unit of the aperture. Pixel windows are
(x0, y0, x1, y1) with y down and the end excluded.

Source: the UsdRenderSettingsBase schema's documentation; the behaviour of OpenUSD's CameraUtil.
"""

from __future__ import annotations

import math

from usdsplat.core.errors import UsageError
from usdsplat.render.specs import Framing

Window = tuple[float, float, float, float]
PixelWindow = tuple[int, int, int, int]

CONFORM = (
    "expandAperture",
    "cropAperture",
    "adjustApertureWidth",
    "adjustApertureHeight",
    "adjustPixelAspectRatio",
)
"""Tokens of `aspectRatioConformPolicy`."""


def conform(window: Window, framing: Framing) -> tuple[Window, float]:
    """Make the aspect ratios of a camera's window and the image equal.

    Args:
        window: The aperture, offsets included.
        framing: The image; its data window is not used.

    Returns:
        The camera window that the display window shows, and the pixels' width over height. The
        policy adjusts one of the two; the other is as given.

    Raises:
        UsageError: If the policy is unknown or the window or the image has no area.
    """
    left, bottom, right, top = window
    width, height = right - left, top - bottom
    columns, rows = framing.resolution
    pixel_aspect = framing.pixel_aspect_ratio
    if framing.conform not in CONFORM:
        raise UsageError("aspectRatioConformPolicy", repr(framing.conform), ", ".join(CONFORM))
    if not (width > 0 and height > 0):
        raise UsageError("camera aperture", f"{width:g} x {height:g}", "a positive size")
    if not (columns > 0 and rows > 0 and 0 < pixel_aspect < math.inf):
        found = f"{columns} x {rows} with pixel aspect ratio {pixel_aspect:g}"
        raise UsageError("resolution", found, "a positive size")
    if framing.conform == "adjustPixelAspectRatio":
        return window, width / height * rows / columns
    aspect = framing.aspect
    if _keeps_height(framing.conform, width / height, aspect):
        middle, half = 0.5 * (left + right), 0.5 * height * aspect
        return (middle - half, bottom, middle + half, top), pixel_aspect
    middle, half = 0.5 * (bottom + top), 0.5 * width / aspect
    return (left, middle - half, right, middle + half), pixel_aspect


def _keeps_height(policy: str, aperture: float, image: float) -> bool:
    """Return whether the policy changes the width. `aperture` and `image` are aspect ratios."""
    if policy in ("adjustApertureWidth", "adjustApertureHeight"):
        return policy == "adjustApertureWidth"
    return (policy == "expandAperture") == (aperture <= image)


def data_window(ndc: Window, resolution: tuple[int, int]) -> PixelWindow | None:
    """Convert a `dataWindowNDC` to pixels.

    Args:
        ndc: (xmin, ymin, xmax, ymax), with (0, 0) the bottom left of the display window and (1, 1)
            its top right; it may reach outside.
        resolution: Columns and rows of the display window [pixel].

    Returns:
        The pixels whose centres are inside the window. Its left and bottom edges are included, its
        right and top edges are not. None if that is the display window.

    Raises:
        UsageError: If no pixel is inside.
    """
    columns, rows = resolution
    x0, x1 = (math.ceil(columns * x - 0.5) for x in (ndc[0], ndc[2]))
    low, high = (math.ceil(rows * y - 0.5) for y in (ndc[1], ndc[3]))
    found = (x0, rows - high, x1, rows - low)
    if x0 >= x1 or low >= high:
        raise UsageError("dataWindowNDC", str(tuple(ndc)), "a window with a pixel in it")
    return None if found == (0, 0, columns, rows) else found
