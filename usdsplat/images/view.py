"""What a display shows of a working space, and what a working space needs so that it is shown.

A view transform is an OCIO display, view and looks from a linear working space, by OpenImageIO. It
is named by five texts and holds nothing else, so it may cross threads and processes.

A capture's colours are code values of an sRGB display. On another display of the config they become
that display's own code values of the same light first, by the config's own conversion, so what is
kept is how the capture looks on an sRGB display. A view whose code values are data, or a config
that has no sRGB display, gives no such conversion: there the code values are the display's own.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import UsageError
from usdsplat.images.color import convert

BUILT_IN = "ocio://default"
"""The config where neither an option nor $OCIO names one."""
CAPTURE_SPACE = "srgb_rec709_display"
ROUND_TRIP = 0.5 / 255
"""Error of a code value that no 8-bit display shows; ACES 2.0 itself comes back within 3e-4."""

ROW = 1024
"""Pixels in a row of those that are converted together."""

ALIASES = {
    "lin_rec709_scene": (
        "Linear Rec.709 (sRGB)",
        "lin_rec709",
        "lin_srgb",
        "Utility - Linear - sRGB",
        "Utility - Linear - Rec.709",
    ),
    "lin_ap1_scene": ("ACEScg", "lin_ap1", "ACES - ACEScg"),
    "lin_ap0_scene": ("ACES2065-1", "lin_ap0", "aces2065_1", "ACES - ACES2065-1"),
    "lin_rec2020_scene": ("Linear Rec.2020", "lin_rec2020", "Utility - Linear - Rec.2020"),
    "lin_p3d65_scene": ("Linear P3-D65", "lin_p3d65", "Utility - Linear - P3-D65"),
    CAPTURE_SPACE: ("sRGB - Display", "srgb_display", "Output - sRGB"),
}
"""What configs that do not know the interop names call our spaces."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewTransform:
    """One view of one working space; `open_view` makes it."""

    working_space: str
    """Linear space of what is viewed, a Gf name."""
    config: str = ""
    """OCIO config, a file or an ocio:// name; "" for none: the plain sRGB curve and a matrix."""
    display: str = ""
    view: str = ""
    looks: str = ""
    source: str = ""
    """What the config calls the working space."""
    target: str = ""
    """What the config calls the display's own space; "" if its code values are sRGB's."""
    capture: str = ""
    """What the config calls the sRGB display's space."""

    @property
    def is_plain(self) -> bool:
        """Whether no OCIO is involved."""
        return not self.config

    def forward(self, rgb: F32) -> F32:
        """Return what the display shows.

        Args:
            rgb: Linear, in the working space, shape (h, w, 3).

        Returns:
            Code values of the display, shape (h, w, 3). The plain transform does not clamp.
        """
        if self.is_plain:
            return convert(rgb, self.working_space, CAPTURE_SPACE).astype(np.float32)
        return self._display(rgb, inverse=False)

    def inverse(self, rgb: F32, *, most: float) -> tuple[F32, Mask]:
        """Return what must be viewed for an sRGB display to show `rgb`.

        Args:
            rgb: Code values of an sRGB display, shape (h, w, 3).
            most: Highest value to return.

        Returns:
            Linear colours in the working space, at most `most`, shape (h, w, 3); and which pixels
            fail, shape (h, w): those of which `forward` makes other code values, `ROUND_TRIP` or
            more away in any channel, because the view cannot show them or `most` is in the way.
        """
        if self.is_plain:
            exact = convert(rgb, CAPTURE_SPACE, self.working_space).astype(np.float32)
            linear = np.minimum(exact, np.float32(most))
            back = self.forward(linear)
        else:
            code = self._convert(rgb, self.capture, self.target)
            linear = np.minimum(self._display(code, inverse=True), np.float32(most))
            back = self._convert(self._display(linear, inverse=False), self.target, self.capture)
        # written so that NaN fails
        failed = ~(np.abs(back - rgb) < ROUND_TRIP).all(axis=-1)
        return linear, failed

    def forward_over(self, image: F32) -> F32:
        """`forward` of a premultiplied picture, shape (h, w, 4); where alpha is 0 it stays."""
        covered = image[..., 3] > 0
        return _with_colors(image, covered, self.forward(_colors(image, covered)))

    def inverse_over(self, image: F32, *, most: float) -> tuple[F32, Mask]:
        """`inverse` of a premultiplied picture, shape (h, w, 4); where alpha is 0 nothing fails."""
        covered = image[..., 3] > 0
        linear, failed = self.inverse(_colors(image, covered), most=most)
        fails = np.zeros(covered.shape, np.bool_)
        fails[covered] = failed.ravel()[: np.count_nonzero(covered)]
        return _with_colors(image, covered, linear), fails

    def _display(self, rgb: F32, *, inverse: bool) -> F32:
        """Through the view, in either direction."""
        import OpenImageIO as oiio

        # The transform of a whole picture is one call: a config is parsed anew for each, 0.1 s.
        return _pixels(
            oiio.ImageBufAlgo.ociodisplay(
                _buffer(rgb),
                self.display,
                self.view,
                fromspace=self.source,
                looks=self.looks,
                unpremult=False,
                inverse=inverse,
                colorconfig=self.config,
            )
        )

    def _convert(self, rgb: F32, source: str, target: str) -> F32:
        """Code values of one display as those of another."""
        import OpenImageIO as oiio

        if not self.target:
            return rgb
        return _pixels(
            oiio.ImageBufAlgo.colorconvert(
                _buffer(rgb), source, target, unpremult=False, colorconfig=self.config
            )
        )


def open_view(
    *,
    config: str = "",
    display: str = "",
    view: str = "",
    look: str = "",
    working_space: str = "lin_rec709_scene",
) -> ViewTransform:
    """Return the view that the names describe; with none of them it is plain sRGB.

    Args:
        config: A file or an ocio:// name; "" for that of the environment, or OCIO's own.
        display: "" for the config's first.
        view: "" for the display's first.
        look: OCIO looks, commas between; "" for those that the view has.
        working_space: A Gf name of a linear space.

    Raises:
        UsageError: If a name does not exist, saying which ones do, or the config cannot be read.
    """
    if not (config or display or view or look):
        return ViewTransform(working_space=working_space)
    import OpenImageIO as oiio

    name = config or os.environ.get("OCIO") or BUILT_IN
    known = oiio.ColorConfig(name)
    if problem := known.geterror() or oiio.geterror():
        expected = f"a file or an ocio:// name that OCIO can read ({problem.splitlines()[0]})"
        raise UsageError("ocio_config", repr(name), expected)
    display = _one_of("ocio_display", display, known.getDisplayNames())
    view = _one_of("ocio_view", view, known.getViewNames(display))
    for each in look.split(",") if look else ():
        _one_of("ocio_look", each.strip().lstrip("+-"), known.getLookNames())
    source = _find(known, working_space)
    if not source:
        names = ", ".join((working_space, *ALIASES.get(working_space, ())))
        expected = f"a config with one of {names}"
        raise UsageError("working_space", f"none such in {name}", expected)
    shown, capture = known.getDisplayViewColorSpaceName(display, view), _find(known, CAPTURE_SPACE)
    converts = bool(capture) and shown != capture and not known.isData(shown)
    return ViewTransform(
        working_space=working_space,
        config=name,
        display=display,
        view=view,
        looks=look,
        source=source,
        target=shown if converts else "",
        capture=capture,
    )


def _one_of(where: str, name: str, known: Iterable[str]) -> str:
    """The name, or the first there is if it is empty."""
    names = tuple(known)
    if not name and names:
        return names[0]
    if name not in names:
        raise UsageError(where, repr(name), f"one of {', '.join(names) or 'none'}")
    return name


def _find(known: Any, space: str) -> str:
    """What a config calls one of our spaces; "" if it has none."""
    for name in (space, *ALIASES.get(space, ())):
        if known.getColorSpaceIndex(name) >= 0:
            return str(known.resolve(name))
    for name in known.getColorSpaceNames():
        if known.get_color_interop_id(name) == space:
            return str(name)
    return ""


def _colors(image: F32, covered: Mask) -> F32:
    """Straight colours of the covered pixels only, in rows that threads can share; the rest is 0.

    A view costs a microsecond a pixel, and half of a picture of a capture is often empty.
    """
    pixels = image[covered]
    rows = np.zeros((max(1, -(-len(pixels) // ROW)), ROW, 3), np.float32)
    rows.reshape(-1, 3)[: len(pixels)] = pixels[:, :3] / pixels[:, 3:]
    return rows


def _with_colors(image: F32, covered: Mask, rows: F32) -> F32:
    """The picture with other straight colours where it is covered."""
    result = image.copy()
    alpha = image[covered][:, 3:]
    result[covered, :3] = rows.reshape(-1, 3)[: len(alpha)] * alpha
    return result


def _buffer(rgb: F32) -> Any:
    """Pixels as OpenImageIO takes them."""
    import OpenImageIO as oiio

    return oiio.ImageBuf(np.ascontiguousarray(rgb, np.float32))


def _pixels(buffer: Any) -> F32:
    """And back; what OCIO cannot do, such as invert some views, is the view's fault."""
    import OpenImageIO as oiio

    if buffer.has_error:
        raise UsageError("ocio_view", buffer.geterror(), "a view that OCIO can apply this way")
    pixels: F32 = buffer.get_pixels(oiio.FLOAT)
    return pixels
