"""antimatter15's .splat: 32 bytes a splat, without a header or harmonics.

Positions and scales are floats; colour, opacity and rotation are bytes. The content has no mark, so
the name identifies the format. Lossy: see `ERROR_BOUNDS`. Harmonics above degree 0, ids and
velocities are not stored.

Source: antimatter15/splat, whose `convert.py` defines the layout. It truncates bytes where this
module rounds, which halves the error; both are decoded alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import FormatError, OutputError
from usdsplat.core.output import output_file
from usdsplat.core.sh import dc_to_rgb, rgb_to_dc
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder, blocks
from usdsplat.formats.options import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions

SUFFIXES: tuple[str, ...] = (".splat",)
FRAME = "rdf"
MAX_DEGREE = 0

ERROR_BOUNDS = {
    "rotations": "0.9 degrees, or 1.8 if the writer truncates",
    "opacities": "1/510, or 1/255 if the writer truncates",
    "sh": "degree 0: 0.007, or 0.014 if the writer truncates, within +-1.77",
}

RECORD = np.dtype(
    [("position", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("rotation", "u1", 4)]
)


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is not empty and has the suffix: its content has no mark."""
    return bool(head) and path.name.lower().endswith(SUFFIXES)


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read all records.

    Raises:
        FormatError: If the file is not a whole number of records, a number in it is not finite, or
            a scale is negative.
    """
    source, size = str(path), path.stat().st_size
    count, rest = divmod(size, RECORD.itemsize)
    if rest or not count:
        raise FormatError(source, f"{size} bytes", f"{RECORD.itemsize} for each splat")
    builder = CloudBuilder(source, count, 0, how)
    with path.open("rb") as file:
        for rows in blocks(count):
            wanted = (rows.stop - rows.start) * RECORD.itemsize
            data = file.read(wanted)
            if len(data) < wanted:  # the file was truncated in the meantime
                raise FormatError(
                    source, f"the end of the file after splat {rows.start}", f"{count} splats"
                )
            _decode(builder, rows, np.frombuffer(data, RECORD))
            builder.settle_linear(rows)
            how.progress.step(f"reading {source}", rows.stop, count)
    cloud, notes = builder.cloud()
    return Capture(
        cloud=cloud,
        format="SPLAT",
        files=(path,),
        frame="rdf",
        frame_source="assumed",
        error_bounds=ERROR_BOUNDS,
        notes=(UNKNOWN_AXES, *notes),
    )


def write(cloud: SplatCloud, path: Path, how: WriteOptions = WRITE_OPTIONS) -> Mapping[str, str]:
    """Write the most visible splats first, as viewers that show files progressively expect.

    Args:
        cloud: Splats; colours outside 0 to 1 are clamped.
        path: Target, replaced when the file is complete.
        how: Only its progress is used: the format has no metadata.

    Returns:
        Error bounds, in the form of `Capture.error_bounds`.

    Raises:
        OutputError: If the target cannot be written, or the cloud is empty: an empty file is
        invalid.
    """
    if not len(cloud):
        raise OutputError(str(path), "no splat to write", "at least one")
    order = np.argsort(-_weight(cloud), kind="stable")
    with output_file(path) as output, output.open() as file:
        for rows in blocks(len(cloud)):
            file.write(_encode(cloud, order[rows]).data)
            how.progress.step(f"writing {path}", rows.stop, len(cloud))
    return ERROR_BOUNDS


def _decode(builder: CloudBuilder, rows: slice, records: npt.NDArray[np.void]) -> None:
    """Decode some rows; splats with a zero rotation, which no writer makes, are dropped later."""
    builder.positions[rows] = records["position"]
    builder.scales[rows] = records["scale"]
    rgba = records["rgba"] / np.float32(255)
    builder.sh[rows, 0] = rgb_to_dc(rgba[:, :3])
    builder.opacities[rows] = rgba[:, 3]
    builder.rotations[rows] = (records["rotation"] - np.float32(128)) / 128


def _encode(cloud: SplatCloud, rows: npt.NDArray[np.intp]) -> npt.NDArray[np.void]:
    """Return the records of some splats."""
    records = np.empty(len(rows), RECORD)
    records["position"] = cloud.positions[rows]
    records["scale"] = cloud.scales[rows]
    rgb = dc_to_rgb(cloud.sh[rows, 0])
    rgba = np.column_stack([rgb, cloud.opacities[rows]])
    records["rgba"] = np.rint(np.clip(rgba, 0, 1) * 255)
    records["rotation"] = np.clip(np.rint(cloud.rotations[rows] * 128 + 128), 0, 255)
    return records


def _weight(cloud: SplatCloud) -> F64:
    """Return volume times opacity, in float64 because products of scales overflow float32."""
    return np.prod(cloud.scales.astype(np.float64), axis=1) * cloud.opacities
