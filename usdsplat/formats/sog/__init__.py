"""PlayCanvas's SOG, versions 1 and 2: lossless WebP images of codes, one pixel per splat.

A zip archive, or a folder with `meta.json`. Positions are 16-bit codes on a logarithmic scale, the
other attributes 8-bit codes into tables, harmonics come from a palette. Lossy: see `ERROR_BOUNDS`.
Version 2 is written.

Source: PlayCanvas, "The SOG Format"; for version 1 the reader of splat-transform. The document
specifies axes "rub", but files of PlayCanvas's tools keep the axes of their source.
"""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

from usdsplat.core.cloud import SplatCloud
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder
from usdsplat.formats.options import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions
from usdsplat.formats.sog import target
from usdsplat.formats.sog.decoding import read_codes, survey
from usdsplat.formats.sog.encoding import EncodedSog, encode
from usdsplat.formats.sog.files import open_sog
from usdsplat.formats.sog.meta import META

SUFFIXES: tuple[str, ...] = (".sog", f"/{META}")
FRAME = "rdf"
MAX_DEGREE = 3
"""Other readers support no higher degree, although the format could hold it."""

ERROR_BOUNDS = {
    "positions": "1/65535 of the range of sign(x) ln(1 + |x|)",
    "scales": "an interval of the file's table of 256 logarithms",
    "rotations": "1.5 degrees",
    "opacities": "1/255",
    "sh": "degree 0: an interval of the file's table of 256; above: the nearest of the palette",
}


def recognises(path: Path, head: bytes) -> bool:
    """Return whether `path` is a zip file, `meta.json`, or a folder that holds one."""
    is_folder = path.is_dir() and (path / META).is_file()
    return is_folder or path.name.lower() == META or head.startswith(b"PK\x03\x04")


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read splats.

    Raises:
        FormatError: If a file is missing or damaged, the size of an image does not match the splats
            or the palette, or `meta.json` has invalid values.
    """
    with open_sog(path) as files:
        sog = survey(files)
        count = sog.meta.count
        builder = CloudBuilder(str(path), count, sog.degree, how)
        done = read_codes(sog).decode([(0, count)], builder, 0)
        how.progress.step(f"reading {path}", done, count)
        paths = files.paths(sog.meta.files)
    cloud, notes = builder.cloud()
    return Capture(
        cloud=cloud,
        format=f"SOG {sog.meta.version}",
        files=paths,
        frame=FRAME,
        frame_source="assumed",
        antialiased=sog.meta.antialiased,
        error_bounds=ERROR_BOUNDS,
        notes=(UNKNOWN_AXES, *notes),
    )


def write(cloud: SplatCloud, path: Path, how: WriteOptions = WRITE_OPTIONS) -> Mapping[str, str]:
    """Write version 2, without ids and velocities; the splats are reordered.

    Args:
        cloud: Finite splats; a scale of 0 becomes exp(-20), because 0 has no logarithm.
        path: A file, or `meta.json` in a folder that is new, empty or holds a SOG.
        how: Whether the file marks the splats as meant for the antialiased projection.

    Returns:
        Error bounds, in the form of `Capture.error_bounds`.

    Raises:
        OutputError: If the target cannot be written.
    """
    encoded = _encoded(cloud, str(path), how)
    if path.name.lower() == META:
        target.write_folder(path, encoded)
    else:
        target.write_archive(path, encoded)
    return ERROR_BOUNDS


def archive(cloud: SplatCloud, name: str, how: WriteOptions = WRITE_OPTIONS) -> bytes:
    """Return the file that `write` makes, for a file of another format that holds it.

    Args:
        cloud: As for `write`.
        name: Name of that file, for messages.
        how: As for `write`.
    """
    file = BytesIO()
    target.write_zip(file, _encoded(cloud, name, how))
    return file.getvalue()


def _encoded(cloud: SplatCloud, name: str, how: WriteOptions) -> EncodedSog:
    """Encode a cloud; `name` is for messages."""
    return encode(
        name,
        cloud,
        antialiased=how.antialiased,
        told=lambda done: how.progress.step(f"writing {name}", done, len(cloud)),
    )
