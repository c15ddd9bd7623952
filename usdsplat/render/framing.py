"""How an image and a camera's aperture meet: conforming the aspect ratio, crop and overscan.

Windows are (left, bottom, right, top) with y up, in whatever unit the aperture has; pixel windows
are (x0, y0, x1, y1) with y down and the end excluded.

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
"""The tokens of `aspectRatioConformPolicy`."""


def conform(window: Window, framing: Framing) -> tuple[Window, float]:
    """Make a camera's window and the image have one aspect ratio.

    Args:
        window: The aperture, offsets included.
        framing: The image; its data window plays no part.

    Returns:
        The window that the display window shows, and the pixels' width over height. Both are as
        given, but for the one that the policy adjusts.

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
    """Whether it is the width that changes; both arguments are aspect ratios."""
    if policy in ("adjustApertureWidth", "adjustApertureHeight"):
        return policy == "adjustApertureWidth"
    return (policy == "expandAperture") == (aperture <= image)


def data_window(ndc: Window, resolution: tuple[int, int]) -> PixelWindow | None:
    """Turn a `dataWindowNDC` into pixels.

    Args:
        ndc: (xmin, ymin, xmax, ymax), with (0, 0) the bottom left of the display window and (1, 1)
            its top right; it may reach outside.
        resolution: Of the display window [pixel].

    Returns:
        The pixels whose centres are inside, those on the left and bottom edge included and those on
        the right and top edge not; None when that is the display window.

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
