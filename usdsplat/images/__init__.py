"""Write pictures with OpenImageIO, and convert colour spaces."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from usdsplat.core.errors import UnknownFormatError
from usdsplat.images.layout import ImageLayout

if TYPE_CHECKING:
    from usdsplat.images.writer import ImageWriter

ColorMode = Literal["display", "scene"]

COLOR_MODES: dict[str, ColorMode] = {
    ".exr": "scene", ".png": "display", ".jpg": "display", ".jpeg": "display", ".webp": "display",
}  # fmt: skip
"""Suffix -> default colour mode of pictures in this format."""


def open_writer(path: Path | str, layout: ImageLayout) -> ImageWriter:
    """Return the writer that the suffix of `path` names; enter it to make the file.

    Raises:
        UnknownFormatError: If no writer has this suffix.
        UsageError: If the format cannot hold the layout.
    """
    # OpenImageIO is imported only when a file is written, not to look up a colour space.
    suffix = _suffix(path)
    if suffix == ".exr":
        from usdsplat.images.exr import ExrWriter

        return ExrWriter(path, layout)
    if suffix in (".jpg", ".jpeg"):
        from usdsplat.images.jpeg import JpegWriter

        return JpegWriter(path, layout)
    if suffix == ".webp":
        from usdsplat.images.webp_writer import WebpWriter

        return WebpWriter(path, layout)
    from usdsplat.images.png import PngWriter

    return PngWriter(path, layout)


def default_color_mode(path: Path | str) -> ColorMode:
    """Return the colour mode for a picture of this suffix: EXR is scene, others are display.

    Raises:
        UnknownFormatError: If no writer has this suffix.
    """
    return COLOR_MODES[_suffix(path)]


def limit_threads(count: int) -> None:
    """Limit all writers of this process together to `count` threads; the default is all."""
    import OpenImageIO

    OpenImageIO.attribute("threads", count)
    OpenImageIO.attribute("exr_threads", count)


def thread_count() -> int:
    """Return the number of threads of a reader or writer, set by `limit_threads` or OpenImageIO."""
    import OpenImageIO

    return max(1, OpenImageIO.get_int_attribute("exr_threads"))


def _suffix(path: Path | str) -> str:
    """Return the suffix in lower case, if there is a writer for it."""
    suffix = Path(path).suffix.lower()
    if suffix not in COLOR_MODES:
        raise UnknownFormatError(
            str(path), f"suffix {suffix!r}", f"one of {', '.join(COLOR_MODES)}"
        )
    return suffix
