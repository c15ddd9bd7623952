"""Read what a RenderProduct asks of husk's writers: header entries, compression, parts.

Source: the attributes that Solaris' Render Product authors: driver:parameters:artist, comment and
hostname, and driver:parameters:OpenEXR:NAME.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
from pxr import Usd, UsdRender

from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.text import shown
from usdsplat.images.compression import DEEP_COMPRESSIONS, FLAT_COMPRESSIONS
from usdsplat.images.layout import Entry
from usdsplat.images.user_metadata import entry

METADATA = "driver:parameters:"
"""Namespace of header entries on products, as husk has it."""
HUSK_ENTRIES = ("artist", "comment", "hostname")
"""Names of header entries in this namespace; all others are in its namespace OpenEXR."""
WRITER_OPTIONS = ("compression", "multipart", "storage", "tiles", "asrgba")
"""Options of other programs' writers in the namespace OpenEXR, which are no entries."""
NOT_HONOURED = {
    "OpenEXR:storage": "splat:tileSize for tiles",
    "OpenEXR:tiles": "splat:tileSize",
    "ocio": "splat:ocioView, splat:ocioDisplay or splat:workingSpace",
}
"""Option of other programs' writers that has no effect -> what to author instead."""


def entries(product: Usd.Prim, time: Usd.TimeCode) -> tuple[tuple[str, Entry], ...]:
    """Return the header entries that a product adds at a time."""
    found = []
    for _, name, value in _added(product, time):
        with suppress(UsageError):  # `problems` reports it
            found.append(entry("", name, value))
    return tuple(found)


def compression(product: Usd.Prim) -> str:
    """Return the compression that a product names for husk, if it is supported; "" for none."""
    asked = _asked(product)
    return asked if asked in _supported(product) else ""


def is_multipart(product: Usd.Prim) -> bool:
    """Return whether a product asks husk for a part for each AOV."""
    attribute = product.GetAttribute(f"{METADATA}OpenEXR:multipart")
    return bool(attribute and attribute.Get())


def problems(product: Usd.Prim, time: Usd.TimeCode) -> Iterator[Finding]:
    """Yield a finding for each of these attributes that is left out."""
    if (asked := _asked(product)) and not compression(product):
        expected = f"one of {', '.join(_supported(product))}"
        where = f"{product.GetPath()}.{METADATA}OpenEXR:compression"
        yield finding("product-metadata", where, repr(asked), expected)
    for name, ours in NOT_HONOURED.items():
        attribute = product.GetAttribute(f"{METADATA}{name}")
        if attribute and attribute.Get() not in (None, "", "scanline"):
            asked = repr(shown(str(attribute.Get())))
            yield finding("product-metadata", str(attribute.GetPath()), asked, ours)
    for where, name, value in _added(product, time):
        try:
            entry("", name, value)
        except UsageError as error:
            yield finding("product-metadata", where, error.found, error.expected)


def _asked(product: Usd.Prim) -> str:
    attribute = product.GetAttribute(f"{METADATA}OpenEXR:compression")
    return str(attribute.Get() or "") if attribute else ""


def _supported(product: Usd.Prim) -> tuple[str, ...]:
    is_deep = UsdRender.Product(product).GetProductTypeAttr().Get() == "deepRaster"
    return DEEP_COMPRESSIONS if is_deep else FLAT_COMPRESSIONS


def _added(product: Usd.Prim, time: Usd.TimeCode) -> Iterator[tuple[str, str, Entry]]:
    """Yield (path of the attribute, name, value) of the entries that a product asks for."""
    for attribute in product.GetAuthoredAttributes():
        if not attribute.GetName().startswith(METADATA):
            continue
        name = attribute.GetName().removeprefix(METADATA)
        is_added = name.startswith("OpenEXR:") or name in HUSK_ENTRIES
        name = name.removeprefix("OpenEXR:")
        value = attribute.Get(time) if is_added and name not in WRITER_OPTIONS else None
        if value is not None and value != "":
            yield str(attribute.GetPath()), name, _header_value(value)


def _header_value(value: Any) -> Entry:
    """Return a value of USD as a header has it: text, a number, or some numbers."""
    if isinstance(value, str | int | float):
        return int(value) if isinstance(value, bool) else value
    try:
        numbers = tuple(float(number) for number in np.asarray(value, np.float64).ravel())
    except (TypeError, ValueError):
        return str(value)
    return numbers if len(numbers) != 1 else numbers[0]
