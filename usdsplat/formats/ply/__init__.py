"""3D Gaussian splatting's PLY files, as written by trainers: one row per splat.

Reads any order of properties, any number type, either byte order and text. Other properties and
elements are ignored. Without `scale_2` splats are flat (2DGS). A file without splat properties is
read as plain points. Writes the property order of INRIA, normals included, because INRIA's viewer
reads by position. Lossless except for the rounding of exp, sigmoid and normalisation.

Source: Kerbl et al. 2023, `scene/gaussian_model.py`: logit of opacity, logarithm of scale, rotation
(w, x, y, z) of any length, harmonics channel by channel. Axes are unstated; trainers keep COLMAP's.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from threading import Lock

import numpy as np

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.encoding import logit, sigmoid
from usdsplat.core.errors import FormatError
from usdsplat.core.output import output_file
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder, in_parallel
from usdsplat.formats.options import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions
from usdsplat.formats.ply.columns import Columns, harmonics
from usdsplat.formats.ply.header import Header, read_header
from usdsplat.formats.ply.points import read_points
from usdsplat.formats.ply.table import Block, Table, open_table

SUFFIXES: tuple[str, ...] = (".ply",)
FRAME = "rdf"

_POSITIONS = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATIONS = ("rot_0", "rot_1", "rot_2", "rot_3")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_SPLAT_ONLY = (*_DC, "opacity", *_SCALES, *_ROTATIONS)

_WRITTEN_ROWS = 4096


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file that starts with `head` is a PLY file."""
    return head.startswith((b"ply\n", b"ply\r", b"ply "))


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read splats, or plain points as small opaque balls.

    Raises:
        FormatError: If the header is inconsistent or lacks properties, or a value is not finite. An
            opacity logit may be infinite, and a logarithm of scale may be minus infinity.
    """
    header = read_header(path)
    table = open_table(path, header, "vertex")
    types = table.types
    missing = [name for name in _POSITIONS if name not in types]
    if not missing and not any(name in types for name in _SPLAT_ONLY):
        return read_points(path, header, table, how)
    return _read_splats(path, header, table, how)


def count_splats(path: Path) -> int | None:
    """Return the number of splats of a file of which `read_part` can read parts; None if it is a
    file of text or of plain points.

    Raises:
        FormatError: If the header is inconsistent.
    """
    header = read_header(path)
    table = open_table(path, header, "vertex")
    has_splats = any(name in table.types for name in _SPLAT_ONLY)
    return table.count if header.byte_order and has_splats else None


def read_part(path: Path, first: int, last: int, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read the splats of rows `first` to `last` of a file for which `count_splats` has a number.

    Raises:
        FormatError: As `read` does.
    """
    header = read_header(path)
    table = open_table(path, header, "vertex")
    return _read_splats(path, header, table.part(first, last), how)


def _read_splats(path: Path, header: Header, table: Table, how: ReadOptions) -> Capture:
    """Read the rows of a table as splats."""
    types = table.types
    missing = [name for name in (*_POSITIONS, *_SPLAT_ONLY) if name not in types]
    missing = [name for name in missing if name != "scale_2"]
    if missing:
        raise FormatError(str(path), f"no property {missing[0]} in element vertex", "one")
    cloud, dropped = _read_rows(str(path), table, how)
    notes = [UNKNOWN_AXES, *dropped, *table.remarks()]
    if "scale_2" not in types:
        notes.append("the file has no scale_2: its splats are flat discs (2DGS)")
    return Capture(
        cloud=cloud,
        format=f"PLY, {header.data_kind}",
        files=(path,),
        frame="rdf",
        frame_source="assumed",
        antialiased=header.is_antialiased,
        notes=tuple(notes),
    )


def write(cloud: SplatCloud, path: Path, how: WriteOptions = WRITE_OPTIONS) -> Mapping[str, str]:
    """Write `cloud` as binary little-endian float32, without ids and velocities.

    Args:
        cloud: Splats; opacity 0 and 1 become infinite logits, scale 0 an infinite logarithm.
        path: Target, replaced when the file is complete.
        how: Whether the header notes that the splats are meant for the antialiased projection.

    Returns:
        Error bounds, in the form of `Capture.error_bounds`.

    Raises:
        OutputError: If the target cannot be written.
    """
    names = _written_names(cloud.sh_degree)
    lines = ["ply", "format binary_little_endian 1.0", "comment Generated by usdsplat"]
    if how.antialiased:
        lines.append("comment SplatRenderMode: mip")
    lines += [f"element vertex {len(cloud)}", *(f"property float {name}" for name in names)]
    header = "\n".join([*lines, "end_header\n"]).encode()
    blocks: list[F32] = []  # idle buffers, taken and returned by threads
    turn = Lock()
    with output_file(path) as output, output.open() as file:
        file.write(header)

        def work(rows: slice) -> None:
            block = blocks.pop() if blocks else np.zeros((_WRITTEN_ROWS, len(names)), "<f4")
            encoded = _encode(cloud, rows, block[: rows.stop - rows.start])
            with turn:
                file.seek(len(header) + rows.start * encoded[0].nbytes)
                file.write(encoded.data)
            blocks.append(block)

        in_parallel(
            len(cloud),
            work,
            rows=_WRITTEN_ROWS,
            told=lambda done: how.progress.step(f"writing {path}", done, len(cloud)),
        )
    return {}


def _read_rows(source: str, table: Table, how: ReadOptions) -> tuple[SplatCloud, tuple[str, ...]]:
    """Decode every row, and return the cloud and notes on dropped splats."""
    degree, rest = harmonics(source, table.types)
    names = {
        "positions": _POSITIONS,
        "scales": tuple(name for name in _SCALES if name in table.types),
        "rotations": _ROTATIONS,
        "opacities": ("opacity",),
        "sh": _DC + rest,
    }
    columns = {field: Columns(table.dtype, wanted) for field, wanted in names.items()}
    builder = CloudBuilder(source, table.count, degree, how)
    scales = builder.scales[:, : len(names["scales"])]
    builder.scales[:, len(names["scales"]) :] = 0

    def work(rows: slice, block: Block) -> None:
        columns["positions"].into(builder.positions[rows], block)
        columns["rotations"].into(builder.rotations[rows], block)
        columns["sh"].into(builder.sh[rows], block)
        columns["opacities"].into(builder.opacities[rows], block)
        columns["scales"].into(scales[rows], block)
        with np.errstate(over="ignore", invalid="ignore"):  # `settle` reports infinities and NaN
            builder.opacities[rows] = sigmoid(builder.opacities[rows])
            np.exp(scales[rows], out=scales[rows])
        builder.settle(rows, lambda field, column: f"property {names[field][column]}")

    table.visit(work, lambda done: how.progress.step(f"reading {source}", done, table.count))
    return builder.cloud()


def _written_names(degree: int) -> list[str]:
    """Return the properties in INRIA's order."""
    rest = 3 * ((degree + 1) ** 2 - 1)
    normals = ["nx", "ny", "nz"]
    harmonics_names = [f"f_rest_{i}" for i in range(rest)]
    return [*_POSITIONS, *normals, *_DC, *harmonics_names, "opacity", *_SCALES, *_ROTATIONS]


def _encode(cloud: SplatCloud, rows: slice, block: F32) -> F32:
    """Fill `block` with some rows of `cloud` and return it; the normals must already be 0."""
    opacity = block.shape[1] - 8
    per_channel = cloud.sh.shape[1] - 1
    block[:, 0:3] = cloud.positions[rows]
    block[:, 6:9] = cloud.sh[rows, 0]
    by_channel = block[:, 9:opacity].reshape(len(block), 3, per_channel)  # a view
    by_channel[:] = cloud.sh[rows, 1:].transpose(0, 2, 1)
    block[:, opacity] = logit(cloud.opacities[rows])
    with np.errstate(divide="ignore"):
        block[:, opacity + 1 : opacity + 4] = np.log(cloud.scales[rows])
    block[:, opacity + 4 :] = cloud.rotations[rows]
    return block
