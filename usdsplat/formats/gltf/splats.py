"""Read all splats of a glTF scene as one capture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from usdsplat.core.errors import FormatError
from usdsplat.formats.capture import Capture
from usdsplat.formats.cloud_builder import CloudBuilder
from usdsplat.formats.gltf.buffers import BinaryChunk, open_buffers
from usdsplat.formats.gltf.document import EXTENSION, Document, Placed
from usdsplat.formats.gltf.parts import Part, open_part
from usdsplat.formats.inflate import check_count
from usdsplat.formats.options import ReadOptions

FRAME = "rub"
"""Axes of glTF: y is up, and a camera without rotation looks along -z."""

METERS_PER_UNIT = 1.0
"""Unit of all lengths in glTF: the metre."""

TEXT_LIMIT = 1 << 27
"""Maximum size of the JSON [byte], data URIs included; larger data belongs in separate files."""

SRGB = "srgb_rec709_display"

_COLOR_SPACES = {SRGB: "srgb_rec709_scene", "lin_rec709_display": "lin_rec709_scene"}
"""Colour spaces of the extension -> USD's, which differ in the image state alone."""


def read_splats(path: Path, text: bytes, chunk: BinaryChunk | None, how: ReadOptions) -> Capture:
    """Read the splats of the default scene, once for each node that shows them.

    Args:
        path: The .gltf or .glb file.
        text: Its JSON text.
        chunk: Location of the binary chunk of a .glb.
        how: Options of the reader.

    Raises:
        FormatError: If the document is invalid, refers to something missing, or shows no splats.
    """
    source = str(path)
    document = Document(source, text)
    placed = document.placed()
    if not placed:
        found = f"{document.others} primitives, none with {EXTENSION}"
        raise FormatError(source, found, "splats in the default scene")
    color_space = _color_space(source, placed)
    with open_buffers(path, document.buffers(), chunk) as buffers:
        parts: dict[str, Part] = {}
        for item in placed:
            if item.primitive.where not in parts:
                parts[item.primitive.where] = open_part(item.primitive, buffers)
        shown = [parts[item.primitive.where] for item in placed]
        files = tuple(buffers.paths)
        total = sum(part.count for part in shown)
        check_count(source, total, sum(file.stat().st_size for file in files))
        builder = CloudBuilder(source, total, max(part.degree for part in shown), how)
        done = 0
        for part, item in zip(shown, placed, strict=True):

            def told(rows: int, before: int = done) -> None:
                how.progress.step(f"reading {source}", before + rows, total)

            part.fill(builder, done, item.matrix, told)
            done += part.count
    cloud, dropped = builder.cloud()
    counted = sum((part.notes for part in parts.values()), Counter[str]())
    return Capture(
        cloud=cloud,
        format="glTF 2.0" if chunk is None else "GLB 2.0",
        files=files,
        frame=FRAME,
        meters_per_unit=METERS_PER_UNIT,
        color_space=color_space,
        error_bounds={k: text for part in parts.values() for k, text in part.error_bounds.items()},
        notes=(
            *dropped,
            *(f"{what}: {n}" for what, n in counted.items()),
            *_remarks(document, placed),
        ),
    )


def _color_space(source: str, placed: Sequence[Placed]) -> str:
    """Return USD's name of the colour space, which all splats must share."""
    said = sorted({item.primitive.color_space for item in placed})
    if len(said) > 1:
        found = f"splats in {len(said)} colour spaces, {said[0][:40]!r} and {said[1][:40]!r}"
        raise FormatError(source, found, "one")
    return _COLOR_SPACES.get(said[0], _COLOR_SPACES[SRGB])


def _remarks(document: Document, placed: Sequence[Placed]) -> list[str]:
    """Return notes on parts of the document that are unknown or left out."""
    remarks = []
    said = placed[0].primitive.color_space
    if said not in _COLOR_SPACES:
        remarks.append(f"colour space {said[:40]!r} is unknown: {SRGB} is assumed")
    for kernel in sorted({item.primitive.kernel for item in placed} - {"ellipse"})[:1]:
        remarks.append(f"kernel {kernel[:40]!r} is unknown: an ellipse is assumed")
    if document.others:
        remarks.append(f"primitives without splats, left out: {document.others}")
    return remarks
