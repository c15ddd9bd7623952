"""Parse the colour behind a picture for displays, and put pictures over it.

The colour is given and composited in code values of the display, as windows, browsers and splat
viewers composite: the result equals the transparent picture over that colour, and an empty pixel
has exactly that colour.
"""

from __future__ import annotations

import re

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.errors import UsageError

Background = tuple[float, float, float]
"""Code values of the display [0..1]."""

AUTO, TRANSPARENT = "auto", "transparent"
NAMES = {"black": "#000000", "grey": "#383838", "gray": "#383838", "white": "#ffffff"}
"""Named colours; grey is that of the window."""
_EXPECTED = "auto, transparent, black, grey, white, #rrggbb, or r,g,b with numbers from 0 to 1"


def normalized(text: str) -> str:
    """Return the text of a background without what does not matter: spaces around it, and case."""
    return text.strip().lower()


def background_source(*, is_requested: bool) -> str:
    """Return what errors call a background: the flag, or the stage's attribute."""
    return "--background" if is_requested else "splat:background"


def parse_background(text: str, *, auto: str, where: str) -> Background | None:
    """Return the colour of a text; None for "transparent".

    Args:
        text: "auto", a name of `NAMES`, #rrggbb, or three numbers from 0 to 1 with commas between.
        auto: What "auto" is.
        where: What the text is, for the message of the error.

    Raises:
        UsageError: If it is anything else.
    """
    text = normalized(text)
    text = auto if text == AUTO else text
    if text == TRANSPARENT:
        return None
    if match := re.fullmatch("#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})", NAMES.get(text, text)):
        red, green, blue = (int(digits, 16) / 255 for digits in match.groups())
        return red, green, blue
    try:
        red, green, blue = map(float, text.split(","))
    except ValueError:
        raise UsageError(where, repr(text), _EXPECTED) from None
    if not all(0.0 <= value <= 1.0 for value in (red, green, blue)):
        raise UsageError(where, repr(text), _EXPECTED)
    return red, green, blue


def described(background: Background | None) -> str:
    """Return the colour as a header entry: #rrggbb, rounded, or "transparent"."""
    if background is None:
        return TRANSPARENT
    return "#" + "".join(f"{int(255 * value + 0.5):02x}" for value in background)


def over(premultiplied: F32, background: Background) -> F32:
    """Return a picture over a colour, shape (..., 3), within 0..1.

    Args:
        premultiplied: RGBA in code values, shape (..., 4). Straight colours are clipped to 0..1
            first, as those of a transparent picture are.
        background: The colour.
    """
    alpha = np.clip(premultiplied[..., 3:], 0, 1)
    behind = np.array(background, np.float32)
    shown: F32 = np.clip(premultiplied[..., :3], 0, alpha) + (1 - alpha) * behind
    return shown
