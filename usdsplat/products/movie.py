"""Write pictures as a movie, with ffmpeg from PATH, or as an animated WebP."""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from usdsplat.core.errors import OutputError
from usdsplat.core.output import output_file, write_output
from usdsplat.images.exif import exif
from usdsplat.images.labels import as_json
from usdsplat.images.layout import Metadata
from usdsplat.products.display_image import Image

SUFFIXES = (".mp4", ".mov")
QUALITY = "16"
"""x264's constant rate factor; compression is not visible at this value."""


def program_for(path: Path) -> str:
    """Return the path of ffmpeg, which writes a movie.

    Raises:
        OutputError: If it is not on PATH.
    """
    program = shutil.which("ffmpeg")
    if program is None:
        expected = "ffmpeg on PATH to write a movie, or a name such as a.####.png"
        raise OutputError(str(path), "no ffmpeg", expected)
    return program


class Movie:
    """Writer of an H.264 movie: a context manager that receives frames.

    The file appears when the context ends without an error, otherwise not at all. Code values are
    those of the pictures, sRGB, tagged as BT.709, as players and editors expect.

    Args:
        path: The file, .mp4 or .mov.
        size: Width and height of every frame [pixel]. For an odd size the last row or column is
            repeated.
        rate: Frame rate [frame/s].
        metadata: Header of the first frame, stored as JSON in the comment of the movie.

    Raises:
        OutputError: On entering, if ffmpeg is missing or the file cannot be written; later, if
            ffmpeg fails or the disk is full.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        rate: float,
        *,
        metadata: Metadata | None = None,
    ) -> None:
        self._path = path
        self._comment = as_json(metadata or {})
        self._size = size
        self._rate = rate

    def __enter__(self) -> Self:
        program = program_for(self._path)
        with ExitStack() as stack:
            output = stack.enter_context(output_file(self._path))
            # A file, because nothing reads a stderr pipe while frames are written to stdin.
            self._said = stack.enter_context(tempfile.TemporaryFile())
            self._process = subprocess.Popen(
                [program, *self._arguments(output.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._said,
            )
            stack.callback(self._end)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            assert self._process.stdin is not None
            try:
                self._process.stdin.close()
            except OSError:
                raise self._refused() from None
            if self._process.wait():
                raise self._refused()

    def write(self, image: Image) -> None:
        """Append a frame: RGB, row 0 at the top, shape (height, width, 3).

        Raises:
            OutputError: If ffmpeg has failed.
        """
        columns, rows = self._size
        if image.shape != (rows, columns, 3):
            raise ValueError(f"frame: found {image.shape}, expected {(rows, columns, 3)}")
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(self._even(image).data)
        except OSError:
            raise self._refused() from None

    def _arguments(self, target: Path) -> list[str]:
        columns, rows = (side + side % 2 for side in self._size)
        pixels = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}"]
        # Without a matrix ffmpeg uses that of standard definition, which shifts colours in players.
        coded = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"
        tags = ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]
        return [
            *("-v", "error", "-nostdin", "-y"),
            *(*pixels, "-framerate", f"{self._rate:g}", "-i", "pipe:0"),
            *("-vf", coded, "-c:v", "libx264", "-crf", QUALITY),
            *(*tags, "-color_range", "tv", "-movflags", "+faststart"),
            *("-metadata", f"comment={self._comment}"),
            *("-f", self._path.suffix.lower()[1:], str(target)),
        ]

    def _even(self, image: Image) -> Image:
        """Return the frame padded to even sizes, because H.264 stores colour for every other pixel
        only."""
        columns, rows = self._size
        filled = np.pad(image, ((0, rows % 2), (0, columns % 2), (0, 0)), mode="edge")
        return np.ascontiguousarray(filled)

    def _refused(self) -> OutputError:
        """Return the error for a failure of ffmpeg, with its last message."""
        self._process.wait()
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        status = f"status {self._process.returncode}"
        found = f"ffmpeg ended with {said[-1] if said else status}"
        return OutputError(str(self._path), found, "a movie that ffmpeg can write")

    def _end(self) -> None:
        """End the process, in any case."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        assert self._process.stdin is not None
        with suppress(OSError):  # a frame may be left in the buffer, and flushing it fails
            self._process.stdin.close()


def save_animation(pictures: Sequence[Path], path: Path, *, rate: float) -> Path:
    """Write PNGs from `draw_frames` as a looping animated WebP, and return its path.

    Args:
        pictures: PNGs in order. The header of the first becomes that of the animation.
        path: The file; an existing one is replaced when the new one is complete.
        rate: Frame rate [frame/s].

    Raises:
        OutputError: If the file cannot be written.
    """
    from PIL import Image as pillow
    from PIL.PngImagePlugin import PngImageFile

    first, *others = [pillow.open(picture) for picture in pictures]
    entries = first.text if isinstance(first, PngImageFile) else {}
    data = io.BytesIO()
    first.save(
        data,
        "WEBP",
        save_all=True,
        append_images=others,
        duration=1000 / rate,
        loop=0,
        exif=exif(entries),
    )
    write_output(path, data.getbuffer())
    return path
