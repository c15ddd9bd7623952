"""Parse `meta.json` of a SOG into checked numbers.

Version 2 has `version`, `count` and codebooks. Version 1 has the shape of `means` instead of the
first two, and ranges instead of codebooks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError
from usdsplat.formats.json_values import numbers, parse_object, show, whole

META = "meta.json"
META_LIMIT = 1 << 20
"""Maximum size of the file [byte]."""

PALETTE_COLUMNS = 64
"""Number of entries of the harmonics palette in a row of its image."""
ROTATION_TAG = 252
"""Alpha of a rotation is this plus the index of the largest component."""

_LARGEST = 1e300

_SECTIONS = {"means": 2, "scales": 1, "quats": 1, "sh0": 1, "shN": 2}
"""Section -> number of its image files."""


@dataclass(frozen=True, slots=True)
class Section:
    """An attribute: its images of codes and the numbers that decode them."""

    where: str
    """Name of the section in error messages."""
    files: tuple[str, ...]
    values: Mapping[str, Any]

    def numbers(self, key: str, length: int) -> F64:
        """Return the `length` finite numbers under `key`; a single one need not be in a list.

        Raises:
            FormatError: If they are missing or invalid.
        """
        value = self.values.get(key)
        items = [value] if length == 1 and not isinstance(value, list) else value
        return numbers(f"{self.where}.{key}", items, length, largest=_LARGEST)

    def whole_number(self, key: str, least: int, most: int) -> int:
        """Return the whole number under `key`.

        Raises:
            FormatError: If it is not a whole number, or outside `least` to `most`.
        """
        return whole(f"{self.where}.{key}", self.values.get(key), least, most)


@dataclass(frozen=True, slots=True)
class Meta:
    """The contents of `meta.json`."""

    version: int
    count: int
    antialiased: bool
    sections: Mapping[str, Section]
    """Sections by name; shN only if there are harmonics above degree 0."""

    @property
    def files(self) -> list[str]:
        """Names of the SOG's files, starting with `meta.json`."""
        return [META, *(name for section in self.sections.values() for name in section.files)]


def parse_meta(source: str, text: bytes) -> Meta:
    """Parse and check `meta.json`; `source` names the SOG in errors.

    Raises:
        FormatError: If it is not JSON, or a value is missing or invalid.
    """
    where = f"{source}: meta.json"
    meta = parse_object(where, text)
    version = whole(f"{where}: version", meta.get("version", 1), 1, 2)
    sections = {
        name: _section(f"{where}: {name}", meta.get(name), files)
        for name, files in _SECTIONS.items()
        if name != "shN" or meta.get("shN") is not None
    }
    count = meta.get("count")
    if version == 1:
        shape = sections["means"].values.get("shape")
        count = shape[0] if isinstance(shape, list) and shape else None
    return Meta(
        version=version,
        count=whole(f"{where}: count", count, 0, 1 << 32),
        antialiased=meta.get("antialias") is True or meta.get("model") == "antialiased",
        sections=sections,
    )


def _section(where: str, value: Any, count: int) -> Section:
    """Return a section, after checking that it has `count` file names."""
    files = value.get("files") if isinstance(value, dict) else None
    if not isinstance(files, list) or [type(name) for name in files] != [str] * count:
        raise FormatError(where, show(value), f"an object with {count} file names")
    return Section(where, tuple(files), value)
