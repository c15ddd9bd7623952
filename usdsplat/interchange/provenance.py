"""Where a field came from, written on the prim so that it stays with the data."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from pxr import Usd, Vt

from usdsplat import __version__, schema
from usdsplat.formats import Capture
from usdsplat.schema import Form

KEY = "usdsplat"
"""The dictionary in the prim's customData."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What is remembered of an import."""

    source: str
    """The file's name without its folder: stages travel."""
    sha256: str
    format: str
    reader: str
    frame: str
    axes: str
    error_bounds: Mapping[str, str]
    notes: tuple[str, ...]


def provenance(
    source: Path, capture: Capture, *, form: Form, axes: str, notes: tuple[str, ...]
) -> Provenance:
    """Gather what is to be remembered; reads the source once more for its fingerprint."""
    folder = source.parent if source.name == "meta.json" else source
    return Provenance(
        source=folder.name,
        sha256=fingerprint(folder),
        format=capture.format,
        reader=f"usdsplat {__version__}",
        frame=capture.frame,
        axes=axes,
        error_bounds=_joined(capture.error_bounds, schema.error_bounds(form)),
        notes=notes,
    )


def record(prim: Usd.Prim, memory: Provenance) -> None:
    """Write it to customData[KEY] of a field."""
    entry = asdict(memory)
    entry["error_bounds"] = dict(memory.error_bounds)
    entry["notes"] = Vt.StringArray(list(memory.notes))
    prim.SetCustomDataByKey(KEY, entry)


def fingerprint(path: Path) -> str:
    """SHA-256 of a file; of a folder, over the names and fingerprints of its files, sorted."""
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    total = hashlib.sha256()
    for item in sorted(path.iterdir()):
        if item.is_file():
            total.update(f"{item.name}\0{fingerprint(item)}\n".encode())
    return total.hexdigest()


def _joined(first: Mapping[str, str], second: Mapping[str, str]) -> dict[str, str]:
    """Bounds that add up, field by field."""
    names = sorted({*first, *second})
    return {name: " + ".join(b[name] for b in (first, second) if name in b) for name in names}
