"""Write pictures as a movie, by the ffmpeg that is on PATH, or as an animated WebP."""

from __future__ import annotations

import json
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
from usdsplat.core.output import atomic_path
from usdsplat.images.layout import Metadata
from usdsplat.products.display_image import Image, exif

SUFFIXES = (".mp4", ".mov")
QUALITY = "16"
"""x264's constant rate factor: what an eye cannot tell from the pictures."""


class Movie:
    """An H.264 movie that is being written: a context manager fed with frames.

    The file appears under its name when the context ends without an error, else not at all. Numbers
    are those of the pictures, sRGB, tagged as BT.709, which is how players and editors show them.

    Args:
        path: The file, .mp4 or .mov.
        size: Of every frame, width and height [pixel]; the last of an odd number is doubled.
        rate: Frames in a second.
        metadata: Header of its first frame, which the comment of the movie holds as JSON.

    Raises:
        OutputError: On entering, if there is no ffmpeg or no place to write; later, if ffmpeg
            refuses or the disk fills up.
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
        self._comment = json.dumps(dict(metadata or {}))
        self._size = size
        self._rate = rate

    def __enter__(self) -> Self:
        program = shutil.which("ffmpeg")
        if program is None:
            expected = "ffmpeg on PATH to write a movie, or a name such as a.####.png"
            raise OutputError(str(self._path), "no ffmpeg", expected)
        with ExitStack() as stack:
            temporary = stack.enter_context(atomic_path(self._path))
            # A file, for nobody reads a pipe of complaints while frames are written to another.
            self._said = stack.enter_context(tempfile.TemporaryFile())
            self._process = subprocess.Popen(
                [program, *self._arguments(temporary)],
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
        """Append a frame; RGB, row 0 at the top, shape (height, width, 3).

        Raises:
            OutputError: If ffmpeg refuses what it has so far.
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
        # Without a matrix ffmpeg takes that of standard definition, and colours shift in players.
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
        """H.264 has colour for every other pixel only."""
        columns, rows = self._size
        filled = np.pad(image, ((0, rows % 2), (0, columns % 2), (0, 0)), mode="edge")
        return np.ascontiguousarray(filled)

    def _refused(self) -> OutputError:
        """What ffmpeg said last."""
        self._process.wait()
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        status = f"status {self._process.returncode}"
        found = f"ffmpeg ended with {said[-1] if said else status}"
        return OutputError(str(self._path), found, "a movie that ffmpeg can write")

    def _end(self) -> None:
        """Whatever happened, leave no process."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        assert self._process.stdin is not None
        with suppress(OSError):  # what a frame left in the buffer has nowhere to go
            self._process.stdin.close()


def save_animation(pictures: Sequence[Path], path: Path, *, rate: float) -> Path:
    """Write PNGs that `draw_frames` wrote as an animated WebP that repeats; return the file.

    Args:
        pictures: In their order; the header of the first becomes that of the animation.
        path: The file, replaced when the new one is complete.
        rate: Frames in a second.

    Raises:
        OutputError: If the file cannot be written.
    """
    from PIL import Image as pillow
    from PIL.PngImagePlugin import PngImageFile

    first, *others = [pillow.open(picture) for picture in pictures]
    entries = first.text if isinstance(first, PngImageFile) else {}
    with atomic_path(path) as temporary:
        first.save(
            temporary,
            save_all=True,
            append_images=others,
            duration=1000 / rate,
            loop=0,
            exif=exif(entries),
        )
    return path
