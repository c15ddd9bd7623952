"""Parse the header of a PLY file: elements, properties, and the offset of the data.

Source: Turk 1994, "The PLY Polygon File Format", with the dialects that captures use: type names
like `float32` and `half`, CRLF and CR line ends.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from usdsplat.core.errors import FormatError

HEADER_LIMIT = 1 << 16
"""Maximum length of a header [byte]: degree 4 needs 3000, a corrupt one may have no end."""
# Digits of the largest count: a file offset has 63 bits.
_MAX_DIGITS = 18
_ORDERS = {b"binary_little_endian": "<", b"binary_big_endian": ">", b"ascii": ""}
_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "half": "f2",
    "float16": "f2",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}


@dataclass(frozen=True, slots=True)
class Element:
    """An `element` line and its properties."""

    name: str
    count: int
    """Number of rows that the header claims, unchecked."""
    types: dict[str, str]
    """Property -> NumPy type code without byte order, in file order; "" for a list."""

    @property
    def has_list(self) -> bool:
        """Whether a property is a list, so that rows have no fixed size."""
        return "" in self.types.values()

    @property
    def row_bytes(self) -> int:
        """Size of a binary row without lists [byte]."""
        return sum(int(code[1:]) for code in self.types.values())


@dataclass(frozen=True, slots=True)
class Header:
    """A parsed PLY header."""

    byte_order: str
    """"<" or ">"; "" when the data is text."""
    comments: tuple[str, ...]
    elements: tuple[Element, ...]
    size: int
    """Offset of the data [byte]."""

    def element(self, name: str) -> Element | None:
        """Return the element called `name`, or None."""
        return next((element for element in self.elements if element.name == name), None)

    @property
    def is_antialiased(self) -> bool:
        """Whether a comment states that the splats are antialiased: `SplatRenderMode: mip` is
        Brush's, the others are Postshot's."""
        said = {" ".join(re.split(r"[\s:=]+", comment.lower())) for comment in self.comments}
        return bool(said & {"splatrendermode mip", "antialiased 1", "postshot.anti_aliasing 1"})

    @property
    def data_kind(self) -> str:
        """Encoding of the data, for display."""
        kinds = {"<": "binary little endian", ">": "binary big endian", "": "ascii"}
        return kinds[self.byte_order]


def read_header(path: Path) -> Header:
    """Parse the header of the file at `path`.

    Raises:
        FormatError: If it is not a PLY header, or does not end within `HEADER_LIMIT`.
    """
    with path.open("rb") as file:
        head = file.read(HEADER_LIMIT)
    return parse_header(str(path), head)


def parse_header(source: str, head: bytes) -> Header:
    """Parse the header at the start of `head`; `source` names it in errors.

    Raises:
        FormatError: If it is not a PLY header, or does not end within `head`.
    """
    lines, size = _lines(source, head)
    orders: list[str] = []
    comments: list[str] = []
    groups: list[tuple[list[bytes], list[list[bytes]]]] = []  # an element and its properties
    for line in lines:
        words = line.split()
        match words:
            case [] | [b"obj_info", *_]:
                pass
            case [b"comment", *_]:
                comments.append(line.strip()[len(b"comment") :].decode("utf-8", "replace").strip())
            case [b"format", kind, _] if kind in _ORDERS:
                orders.append(_ORDERS[kind])
            case [b"element", _, _]:
                groups.append((words, []))
            case [b"property", _, _] | [b"property", b"list", _, _, _] if groups:
                groups[-1][1].append(words)
            case _:
                raise FormatError(source, f"header line {_show(line)}", "a line of a PLY header")
    if len(orders) != 1:
        raise FormatError(source, f"{len(orders)} format lines in the header", "one")
    elements = tuple(_element(source, words, properties) for words, properties in groups)
    names = [element.name for element in elements]
    if len(set(names)) < len(names):
        raise FormatError(source, f"elements {', '.join(names)}", "each element once")
    return Header(orders[0], tuple(comments), elements, size)


def _lines(source: str, head: bytes) -> tuple[list[bytes], int]:
    """Return the lines between `ply` and `end_header`, and the offset of the data."""
    first = re.match(rb"ply *([\r\n]{1,2})", head)
    if not first:
        raise FormatError(source, f"{_show(head[:4])} at the start", "a line 'ply'")
    # CRLF lines end in LF as well. A file whose lines end in CR alone must be recognised by its
    # first line: the first byte of the data may look like the LF of a CRLF.
    end = b"\r" if first[1] in (b"\r", b"\r\r") else b"\n"
    lines: list[bytes] = []
    start = head.index(end) + 1
    while (stop := head.find(end, start)) >= 0:
        line = head[start:stop]
        start = stop + 1
        if line.strip() == b"end_header":
            return lines, start
        lines.append(line)
    raise FormatError(source, f"no end_header in the first {len(head)} bytes", "a PLY header")


def _element(source: str, words: list[bytes], properties: list[list[bytes]]) -> Element:
    """Return the element that an `element NAME COUNT` line and its `property` lines declare."""
    name, count = words[1].decode("utf-8", "replace"), words[2]
    if not count.isdigit() or len(count) > _MAX_DIGITS:
        found = f"{_show(count)} as the count of element {name}"
        raise FormatError(source, found, "a number of rows")
    types: dict[str, str] = {}
    for line in properties:
        *codes, label = (word.decode("utf-8", "replace") for word in line[1:])
        is_list = len(codes) > 1
        unknown = [code for code in codes[is_list:] if code not in _TYPES]
        if unknown:
            raise FormatError(source, f"property type {unknown[0]!r}", "a type of PLY")
        if label in types:
            raise FormatError(source, f"property {label} twice in {name}", "each property once")
        types[label] = "" if is_list else _TYPES[codes[0]]
    return Element(name, int(count), types)


def _show(text: bytes) -> str:
    """Return bytes of a file, shortened for an error message."""
    return repr(text[:40].decode("latin-1"))
