"""Draw a picture in tiles, which several processes draw, and join them.

A tile is drawn into a file of its own in the folder PICTURE.tiles, with the values that the file of
the picture gets, before they are compressed. Joining the tiles writes the same bytes as drawing the
whole picture, but for the date. Then it removes the folder.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import I64
from usdsplat.core.errors import FormatError, OutputError, UsageError
from usdsplat.core.folders import made_folder
from usdsplat.core.output import remove_stale
from usdsplat.core.pairs import whole_pair
from usdsplat.delegate.engine import Engine
from usdsplat.images.deep import DeepBand
from usdsplat.products.deep import DeepReport, deep_bands, write_deep
from usdsplat.products.flat import flat_bands, write_flat
from usdsplat.products.picture_file import PictureFile, RowsWritten
from usdsplat.products.request import PicturePlan, Window
from usdsplat.render.band import Band
from usdsplat.render.frame_stats import FrameStats
from usdsplat.sim.arrays_file import load_arrays, save_arrays

MOST = 64
"""Largest number of columns and of rows of tiles."""
_ROWS = 64
"""Rows that are joined at once."""
_ID = "id:"
"""Beginning of the names of the channels of ids in a deep tile."""
_DEEP = ("counts", "depth", "depth_back", "color")

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class Tiling:
    """Division of pictures into tiles, which are numbered from 1 by row from the top left."""

    columns: int
    rows: int

    @classmethod
    def parse(cls, text: str) -> Tiling:
        """Return the value of `--tiles`, COLUMNSxROWS.

        Raises:
            UsageError: If it is anything else.
        """
        found = whole_pair(text, "x")
        if found is None or max(found) > MOST:
            expected = f"COLUMNSxROWS, each 1 to {MOST}, such as 2x2"
            raise UsageError("--tiles", repr(text), expected)
        return cls(*found)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

    def __len__(self) -> int:
        return self.columns * self.rows

    def check(self, whole: Window) -> None:
        """Raise an error if a tile of a picture would be empty.

        Raises:
            UsageError: If there are more tiles than pixels along an axis.
        """
        width, height = whole[2] - whole[0], whole[3] - whole[1]
        if self.columns > width or self.rows > height:
            found = f"{self} tiles of {width}x{height} pixels"
            raise UsageError("--tiles", found, "at least a pixel for each tile")

    def window(self, number: int, whole: Window) -> Window:
        """Return the pixels of a tile: (x0, y0, x1, y1), ends exclusive.

        Args:
            number: 1 to len(self).
            whole: Data window of the picture.
        """
        row, column = divmod(number - 1, self.columns)
        (x0, y0, x1, y1), columns, rows = whole, self.columns, self.rows
        xs = [x0 + (x1 - x0) * each // columns for each in (column, column + 1)]
        ys = [y0 + (y1 - y0) * each // rows for each in (row, row + 1)]
        return xs[0], ys[0], xs[1], ys[1]


@dataclass(frozen=True, slots=True)
class TileStep:
    """What to do with the tiles of each picture: draw one of them, or join all."""

    tiling: Tiling
    number: int
    """Tile to draw, from 1; 0 to join all."""
    keeps: bool = False
    """Whether tiles are left after they were joined."""

    @classmethod
    def parse(cls, tiling: Tiling, text: str, *, keeps: bool = False) -> TileStep:
        """Return the value of `--tile`, a number or "join".

        Raises:
            UsageError: If it is anything else.
        """
        if text == "join":
            return cls(tiling, 0, keeps)
        if not re.fullmatch(r"\d{1,4}", text) or not 1 <= int(text) <= len(tiling):
            raise UsageError("--tile", repr(text), f"1 to {len(tiling)}, or join")
        return cls(tiling, int(text))

    @property
    def joins(self) -> bool:
        """Whether tiles are joined."""
        return self.number == 0

    def planned(self, plan: PicturePlan) -> PicturePlan:
        """Return the plan of what is drawn: the tile, or the whole picture to join."""
        self.tiling.check(plan.framing.window)
        if self.joins:
            return plan
        window = self.tiling.window(self.number, plan.framing.window)
        return replace(plan, framing=replace(plan.framing, data_window=window))

    def path(self, picture: Path, number: int | None = None) -> Path:
        """Return the file of a tile of a picture; of this step's tile by default."""
        number = self.number if number is None else number
        return picture.with_name(f"{picture.name}.tiles") / f"{number:04d}-of-{self.tiling}.tile"

    def write(
        self,
        engine: Engine,
        file: PictureFile,
        picture: Path,
        stamped: str,
        *,
        rows_written: RowsWritten,
    ) -> tuple[DeepReport | None, FrameStats]:
        """Draw the tile at the engine's time, or join all. Return a report for a deep picture, and
        the counts of splats.

        Args:
            engine: Engine that draws.
            file: The tile or the picture.
            picture: Path of the picture.
            stamped: See `picture_stamp`.
            rows_written: See `draw_flat`.

        Raises:
            OutputError: If a tile to join is missing, or the file cannot be written.
            FormatError: If a tile to join is damaged.
        """
        if not self.joins:
            report = draw_tile(engine, file, stamped=stamped, rows_written=rows_written)
            return report, engine.stats
        joined = JoinedTiles(self, picture, file.plan.framing.window, stamped)
        report = joined.write(file, rows_written=rows_written)
        if not self.keeps:
            remove_tiles(picture)
        return report, joined.stats


def is_drawn(path: Path, stamped: str, device: str) -> bool:
    """Return whether the file of a tile is complete, has a stamp, and was drawn by a device."""
    try:
        known = load_arrays(path)[1] if path.is_file() else {}
    except (FormatError, OSError):
        return False
    return known.get("stamp") == stamped and known.get("device") == device


def remove_tiles(picture: Path) -> None:
    """Remove all tiles of a picture, whatever their tiling; it is complete.

    What cannot be removed stays: a farm's workers may be another user than who asked for the job.
    """
    folder = TileStep(Tiling(1, 1), 0).path(picture).parent
    with suppress(OSError):  # there is none, or another process removes it
        for path in list(folder.glob("*.tile")):
            with suppress(OSError):
                path.unlink()
        remove_stale(folder)
        folder.rmdir()


_COUNTS = ("splats", "total", "visible", "of_trees", "missing")
"""Counts of `FrameStats`; those of the picture are the largest ones of its tiles."""
_ADDED = ("failed", "asked")
"""Counts of `FrameStats` that are added over the tiles."""


def draw_tile(
    engine: Engine, file: PictureFile, *, stamped: str, rows_written: RowsWritten
) -> DeepReport | None:
    """Draw one tile at the engine's time into its file. Return a report for a deep picture.

    Args:
        engine: Engine that draws.
        file: The tile: a plan whose data window it is, and its path.
        stamped: See `picture_stamp`.
        rows_written: See `draw_flat`.

    Raises:
        UsageError: See `draw_deep`.
        OutputError: If the file cannot be written.
    """
    top = file.layout.window[1]
    report = DeepReport() if file.plan.deep else None
    arrays: dict[str, Array]
    if report is not None:
        parts = []
        for y0, band in deep_bands(engine, file, report):
            parts.append(_copied(band))  # the next band has the same memory
            rows_written(y0 + len(band.counts) - top)
        arrays = {name: np.concatenate([getattr(each, name) for each in parts]) for name in _DEEP}
        for name in parts[0].ids:
            arrays[f"{_ID}{name}"] = np.concatenate([each.ids[name] for each in parts])
    else:
        arrays = {}
        for drawn in flat_bands(engine, file):
            for name, rows in drawn.arrays.items():
                if name not in arrays:
                    height = file.layout.window[3] - top
                    arrays[name] = np.empty((height, *rows.shape[1:]), rows.dtype)
                arrays[name][drawn.y0 - top : drawn.y1 - top] = rows
            rows_written(drawn.y1 - top)
    counts = {name: getattr(engine.stats, name) for name in (*_COUNTS, *_ADDED)}
    meta = {
        "stamp": stamped,
        "device": engine.device,
        "counts": counts,
        "deep": None if report is None else asdict(report),
    }
    with made_folder(file.path.parent):  # others may have removed it, when they failed
        save_arrays(file.path, arrays, meta)
    return report


def _copied(band: DeepBand) -> DeepBand:
    arrays = {name: getattr(band, name).copy() for name in _DEEP}
    return DeepBand(**arrays, ids={name: values.copy() for name, values in band.ids.items()})


class JoinedTiles:
    """The tiles of a picture, as one. Their arrays are mapped, not read.

    Args:
        step: The tiling.
        picture: Path of the picture.
        whole: Its data window.
        stamped: See `picture_stamp`.

    Raises:
        OutputError: If a tile is missing, is one of another picture, or if tiles were drawn by
            different devices.
        FormatError: If a tile is damaged.
    """

    def __init__(self, step: TileStep, picture: Path, whole: Window, stamped: str) -> None:
        self._tiling, self._whole = step.tiling, whole
        self.stats = FrameStats()
        """Counts of the picture."""
        self.report = DeepReport()
        """What the tiles of a deep picture report."""
        devices: set[str] = set()
        self._paths = [step.path(picture, number + 1) for number in range(len(step.tiling))]
        for path in self._paths:
            if not path.is_file():
                raise OutputError(str(path), "no file", "a tile that was drawn before: --tile N")
            _, meta = load_arrays(path, mapped=True, checked=False)
            if meta["stamp"] != stamped:
                raise OutputError(str(path), "a tile of another picture", "one of this picture")
            devices.add(meta["device"])
            if len(devices) > 1:
                found = f"tiles that {' and '.join(sorted(devices))} drew"
                raise OutputError(str(picture), found, "tiles of one device: --device")
            counts = meta["counts"]
            for name in _COUNTS:
                setattr(self.stats, name, max(getattr(self.stats, name), counts[name]))
            for name in _ADDED:
                setattr(self.stats, name, getattr(self.stats, name) + counts[name])
            if meta["deep"] is not None:
                self._report(DeepReport(**meta["deep"]))

    def write(self, file: PictureFile, *, rows_written: RowsWritten) -> DeepReport | None:
        """Write the picture. Return a report for a deep picture.

        Raises:
            OutputError: If the file cannot be written.
        """
        if file.plan.deep:
            write_deep(file, self._deep_bands(), self.report, rows_written=rows_written)
        else:
            write_flat(file, self._flat_bands(), rows_written=rows_written)
        return self.report if file.plan.deep else None

    # --- private ---------------------------------------------------------------------------

    def _report(self, tile: DeepReport) -> None:
        found = self.report
        found.compared, found.blend_space = tile.compared, tile.blend_space
        found.samples += tile.samples
        found.pixels += tile.pixels
        found.squares += tile.squares
        found.worst = max(found.worst, tile.worst)
        found.missing = max(found.missing, tile.missing)

    def _strips(self) -> Iterator[tuple[int, int, int, list[dict[str, Array]]]]:
        """Yield the first row of some rows of the picture, their first and last row in the tiles,
        and these tiles, from the left."""
        for row in range(self._tiling.rows):
            first = row * self._tiling.columns
            paths = self._paths[first : first + self._tiling.columns]
            # mapped files are open files: only those of one row of tiles at a time
            tiles = [load_arrays(path, mapped=True, checked=False)[0] for path in paths]
            _, top, _, bottom = self._tiling.window(first + 1, self._whole)
            for y0 in range(top, bottom, _ROWS):
                yield y0, y0 - top, min(y0 + _ROWS, bottom) - top, tiles

    def _flat_bands(self) -> Iterator[Band]:
        for y0, first, last, tiles in self._strips():
            arrays = {
                name: np.concatenate([each[name][first:last] for each in tiles], axis=1)
                for name in tiles[0]
            }
            yield Band(y0, y0 + last - first, arrays)

    def _deep_bands(self) -> Iterator[tuple[int, DeepBand]]:
        for y0, first, last, tiles in self._strips():
            counts = [each["counts"][first:last] for each in tiles]
            rows = [_row_ranges(each["counts"])[first : last + 1] for each in tiles]
            arrays = {
                name: _by_row([each[name] for each in tiles], rows)
                for name in tiles[0]
                if name != "counts"
            }
            ids = {name[3:]: arrays.pop(name) for name in tuple(arrays) if name.startswith(_ID)}
            yield y0, DeepBand(counts=np.concatenate(counts, axis=1), ids=ids, **arrays)


def _row_ranges(counts: Array) -> I64:
    """Return where the samples of each row begin, and where those of the last one end."""
    return np.concatenate([[0], np.cumsum(counts.sum(axis=1, dtype=np.int64))])


def _by_row(arrays: Sequence[Array], rows: Sequence[I64]) -> Array:
    """Return the samples of tiles beside each other, ordered by row.

    Args:
        arrays: Values of the samples of each tile.
        rows: Where each row begins in each tile, and where the last one ends.
    """
    parts = [
        array[ends[row] : ends[row + 1]]
        for row in range(len(rows[0]) - 1)
        for array, ends in zip(arrays, rows, strict=True)
    ]
    return np.concatenate(parts)
