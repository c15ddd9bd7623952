"""Base class of picture writers, which write rows to a temporary file."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from usdsplat.core.errors import OutputError
from usdsplat.core.output import OutputFile, output_file
from usdsplat.core.renames import EXPECTED
from usdsplat.images.layout import Band, ImageLayout

ROWS = 64
"""Number of rows processed at a time: copies of them stay in the cache."""


class ImageWriter(ABC):
    """Writer of a picture file: a context manager that takes bands, top to bottom.

    The file appears under its name when the context ends without an error, else not at all. A
    format implements `_append` for the rows of a band, and `_finish` for data after the last row.
    """

    FORMAT: str
    """OpenImageIO's name of the format."""

    def __init__(
        self, path: Path | str, layout: ImageLayout, specs: tuple[oiio.ImageSpec, ...]
    ) -> None:
        self._path = Path(path)
        self._layout = layout
        self._specs = specs
        self._next_row = layout.window[1]

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            output = stack.enter_context(output_file(self._path, is_whole=self._is_whole))
            self._begin(output, stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._abandon()
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            bottom = self._layout.window[3]
            if self._next_row != bottom:
                raise ValueError(f"{self._path}: found rows to {self._next_row}, expected {bottom}")
            self._finish()
            self._end()

    def write_band(self, y0: int, band: Band) -> None:
        """Append whole rows.

        Args:
            y0: First row [pixel], in display window coordinates; it must follow the last band.
            band: AOV name -> float32 or uint32 (ids) array, shape (rows, width) for one channel and
                (rows, width, channels) for more; AOVs that the layout does not name are ignored.

        Raises:
            OutputError: If the file cannot be written.
            ValueError: If rows are out of order, or an array does not match its AOV.
        """
        rows = self._layout.rows_of(y0, band)
        if y0 != self._next_row or not 0 < rows <= self._layout.window[3] - y0:
            raise ValueError(f"band: found rows {y0} to {y0 + rows}, expected {self._next_row} on")
        for first in range(0, rows, ROWS):
            part = slice(first, first + ROWS)
            self._append(y0 + first, {name: band[name][part] for name in self._layout.aovs})
        self._next_row += rows

    def _begin(self, output: OutputFile, stack: ExitStack) -> None:
        """Open the temporary file; `stack` closes it after an error."""
        self._temporary = output.text
        file = oiio.ImageOutput.create(self.FORMAT)
        if file is None:
            raise OutputError(str(self._path), oiio.geterror(), f"support for {self.FORMAT}")
        self._file = file
        stack.callback(file.close)
        self._check(self._file.open(self._temporary, self._specs))

    def _end(self) -> None:
        """Close the finished file."""
        self._check(self._file.close())

    @abstractmethod
    def _append(self, y0: int, band: Band) -> None:
        """Write some rows of a checked band."""

    def _finish(self) -> None:  # noqa: B027 - most formats have nothing there
        """Write data after the last row."""

    def _abandon(self) -> None:  # noqa: B027 - most formats need nothing
        """Prepare closing a file that will not be finished."""

    @abstractmethod
    def _is_whole(self, path: Path) -> bool:
        """Return whether the closed file is complete, because OpenImageIO's writers do not report
        all errors."""

    def _write_rows(self, y0: int, pixels: npt.NDArray[np.generic]) -> None:
        """Append `pixels` of shape (rows, width, channels) to the open part."""
        self._check(self._file.write_scanlines(y0, y0 + len(pixels), 0, pixels))

    def _open_next_part(self, spec: oiio.ImageSpec) -> None:
        """Open the next part of a multipart file."""
        self._check(self._file.open(self._temporary, spec, "AppendSubimage"))

    def _check(self, succeeded: bool) -> None:
        """Raise an error if OpenImageIO failed; reading its message keeps it from printing it at
        exit."""
        message = self._file.geterror() or oiio.geterror()
        if not succeeded:
            found = message.replace(self._temporary, self._path.name).strip().rstrip(".")
            reason = re.split(r"[.:]\s+", found)[-1]  # of several sentences, the most special
            raise OutputError(str(self._path), f"a write that failed ({reason})", EXPECTED)
