"""`meta.json` of a SOG: JSON of any shape in, checked numbers out.

Version 2 says `version`, `count` and codebooks; version 1 says none of these but the shape of
`means`, and ranges where version 2 has codebooks.
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
"""Bytes of it that are read."""

PALETTE_COLUMNS = 64
"""Entries of the palette of harmonics in a row of its image."""
ROTATION_TAG = 252
"""Alpha of a rotation: this and the index of the largest component."""

_LARGEST = 1e300

_SECTIONS = {"means": 2, "scales": 1, "quats": 1, "sh0": 1, "shN": 2}
"""Section -> number of its image files."""


@dataclass(frozen=True, slots=True)
class Section:
    """One attribute: the images that hold its codes and the numbers that decode them."""

    where: str
    """Names the section in errors."""
    files: tuple[str, ...]
    values: Mapping[str, Any]

    def numbers(self, key: str, length: int) -> F64:
        """The `length` finite numbers under `key`; a single one may stand without a list.

        Raises:
            FormatError: If there are none such.
        """
        value = self.values.get(key)
        items = [value] if length == 1 and not isinstance(value, list) else value
        return numbers(f"{self.where}.{key}", items, length, largest=_LARGEST)

    def whole_number(self, key: str, least: int, most: int) -> int:
        """The whole number under `key`.

        Raises:
            FormatError: If it is none, or outside `least` to `most`.
        """
        return whole(f"{self.where}.{key}", self.values.get(key), least, most)


@dataclass(frozen=True, slots=True)
class Meta:
    """What `meta.json` says."""

    version: int
    count: int
    antialiased: bool
    sections: Mapping[str, Section]
    """By name; shN only where there are harmonics above degree 0."""

    @property
    def files(self) -> list[str]:
        """Names of the SOG's files, `meta.json` the first."""
        return [META, *(name for section in self.sections.values() for name in section.files)]


def parse_meta(source: str, text: bytes) -> Meta:
    """Parse and check `meta.json`; `source` names the SOG in errors.

    Raises:
        FormatError: If it is not JSON, or lacks something, or something has an impossible value.
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
    """The section under a name, if it is an object with that many file names."""
    files = value.get("files") if isinstance(value, dict) else None
    if not isinstance(files, list) or [type(name) for name in files] != [str] * count:
        raise FormatError(where, show(value), f"an object with {count} file names")
    return Section(where, tuple(files), value)
