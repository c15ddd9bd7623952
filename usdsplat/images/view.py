"""Apply OCIO view transforms and their inverses.

A view transform is an OCIO display, view and looks for a linear working space, applied by
OpenImageIO. It consists of strings only, so it may be passed between threads and processes.

A capture's colours are code values of an sRGB display. For another display of the config, they are
first converted to that display's code values by the config's own conversion, which keeps the
appearance on an sRGB display. There is no such conversion if the view's code values are data or the
config has no sRGB display: then they are used as the display's own code values.
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
from usdsplat.core.readable import readable
from usdsplat.images.color import convert

BUILT_IN = "ocio://default"
"""Config if neither an option nor $OCIO names one."""
CAPTURE_SPACE = "srgb_rec709_display"
ROUND_TRIP = 0.5 / 255
"""Tolerance of code values, invisible on an 8-bit display; ACES 2.0 round-trips within 3e-4."""

ROW = 1024
"""Number of pixels in a row of the array in which covered pixels are passed to OpenImageIO."""

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
"""Names of our spaces in configs without the interop names."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewTransform:
    """A view of a working space, created by `open_view`."""

    working_space: str
    """Linear colour space of the input, a Gf name."""
    config: str = ""
    """OCIO config, a file or an ocio:// name; "" for the plain sRGB curve and a matrix."""
    display: str = ""
    view: str = ""
    looks: str = ""
    source: str = ""
    """Name of the working space in the config."""
    target: str = ""
    """Name of the display's space in the config; "" if its code values are sRGB's."""
    capture: str = ""
    """Name of the sRGB display's space in the config."""

    @property
    def is_plain(self) -> bool:
        """Whether OCIO is not used."""
        return not self.config

    def forward(self, rgb: F32) -> F32:
        """Apply the view.

        Args:
            rgb: Linear colours in the working space, shape (h, w, 3).

        Returns:
            Code values of the display, shape (h, w, 3). The plain transform does not clamp.
        """
        if self.is_plain:
            return convert(rgb, self.working_space, CAPTURE_SPACE).astype(np.float32)
        return self._display(rgb, inverse=False)

    def inverse(self, rgb: F32, *, most: float) -> tuple[F32, Mask]:
        """Return the colours for which the view shows `rgb` on an sRGB display.

        Args:
            rgb: Code values of an sRGB display, shape (h, w, 3).
            most: Highest value to return.

        Returns:
            Linear colours in the working space, at most `most`, shape (h, w, 3); and which pixels
            fail, shape (h, w). A pixel fails if `forward` returns a code value that differs by
            `ROUND_TRIP` or more in any channel, because the view cannot show it or `most` limits
            it.
        """
        if self.is_plain:
            exact = convert(rgb, CAPTURE_SPACE, self.working_space).astype(np.float32)
            linear = np.minimum(exact, np.float32(most))
            back = self.forward(linear)
        else:
            code = self._convert(rgb, self.capture, self.target)
            linear = np.minimum(self._display(code, inverse=True), np.float32(most))
            back = self._convert(self._display(linear, inverse=False), self.target, self.capture)
        # Written so that NaN fails.
        failed = ~(np.abs(back - rgb) < ROUND_TRIP).all(axis=-1)
        return linear, failed

    def forward_over(self, image: F32) -> F32:
        """Apply `forward` to a premultiplied picture, shape (h, w, 4); alpha 0 stays unchanged."""
        covered = image[..., 3] > 0
        return _with_colors(image, covered, self.forward(_colors(image, covered)))

    def inverse_over(self, image: F32, *, most: float) -> tuple[F32, Mask]:
        """Apply `inverse` to a premultiplied picture, shape (h, w, 4); alpha 0 never fails."""
        covered = image[..., 3] > 0
        linear, failed = self.inverse(_colors(image, covered), most=most)
        fails = np.zeros(covered.shape, np.bool_)
        fails[covered] = failed.ravel()[: np.count_nonzero(covered)]
        return _with_colors(image, covered, linear), fails

    def _display(self, rgb: F32, *, inverse: bool) -> F32:
        """Apply the view in either direction."""
        import OpenImageIO as oiio

        # One call for the whole picture: each call parses the config again, which takes 0.1 s.
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
        """Convert code values of one display to those of another."""
        import OpenImageIO as oiio

        if not self.target:
            return rgb
        return _pixels(
            oiio.ImageBufAlgo.colorconvert(
                _buffer(rgb), source, target, unpremult=False, colorconfig=self.config
            )
        )


def config_in_effect(config: str) -> str:
    """Return the config that OCIO reads: a file or an ocio:// name.

    Args:
        config: The one that is asked for; "" for that of the environment, or the built-in one.
    """
    return config or os.environ.get("OCIO") or BUILT_IN


def open_view(
    *,
    config: str = "",
    display: str = "",
    view: str = "",
    look: str = "",
    working_space: str = "lin_rec709_scene",
) -> ViewTransform:
    """Create the view with these names; without any it is plain sRGB.

    Args:
        config: A file or an ocio:// name; "" for that of the environment, or the built-in one.
        display: OCIO display; "" for the config's first.
        view: OCIO view; "" for the display's first.
        look: OCIO looks, separated by commas; "" for those of the view.
        working_space: A Gf name of a linear space.

    Raises:
        UsageError: If a name is unknown, listing the known ones, or the config cannot be read.
    """
    if not (config or display or view or look):
        return ViewTransform(working_space=working_space)
    import OpenImageIO as oiio

    name = readable(config_in_effect(config))
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
        raise UsageError(
            "working_space", f"{working_space!r}, which {name} does not have", expected
        )
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
    """Return the name, or the first known one if it is empty."""
    names = tuple(known)
    if not name and names:
        return names[0]
    if name not in names:
        raise UsageError(where, repr(name), f"one of {', '.join(names) or 'none'}")
    return name


def _find(known: Any, space: str) -> str:
    """Return the name of one of our spaces in a config; "" if it has none."""
    for name in (space, *ALIASES.get(space, ())):
        if known.getColorSpaceIndex(name) >= 0:
            return str(known.resolve(name))
    for name in known.getColorSpaceNames():
        if known.get_color_interop_id(name) == space:
            return str(name)
    return ""


def _colors(image: F32, covered: Mask) -> F32:
    """Return straight colours of the covered pixels, in rows for threads; padded with 0.

    A view takes a microsecond per pixel, and often half of a capture's picture is empty.
    """
    pixels = image[covered]
    rows = np.zeros((max(1, -(-len(pixels) // ROW)), ROW, 3), np.float32)
    rows.reshape(-1, 3)[: len(pixels)] = pixels[:, :3] / pixels[:, 3:]
    return rows


def _with_colors(image: F32, covered: Mask, rows: F32) -> F32:
    """Return the picture with new straight colours in covered pixels."""
    result = image.copy()
    alpha = image[covered][:, 3:]
    result[covered, :3] = rows.reshape(-1, 3)[: len(alpha)] * alpha
    return result


def _buffer(rgb: F32) -> Any:
    """Convert pixels to an OpenImageIO buffer."""
    import OpenImageIO as oiio

    return oiio.ImageBuf(np.ascontiguousarray(rgb, np.float32))


def _pixels(buffer: Any) -> F32:
    """Convert a buffer to pixels; raise an error if OCIO failed, such as for a view without
    inverse."""
    import OpenImageIO as oiio

    if buffer.has_error:
        raise UsageError("ocio_view", buffer.geterror(), "a view that OCIO can apply this way")
    pixels: F32 = buffer.get_pixels(oiio.FLOAT)
    return pixels
