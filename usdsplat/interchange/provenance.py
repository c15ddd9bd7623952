"""Where a field came from, written on the prim so that it stays with the data."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pxr import Usd, Vt

from usdsplat import __version__, schema
from usdsplat.core.edits import Edit
from usdsplat.formats import Capture
from usdsplat.interchange.editing import UNBOUNDED, bounds_after
from usdsplat.schema import Form

KEY = "usdsplat"
"""The dictionary in the prim's customData."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What is remembered of an import."""

    source: str
    """The file's name without its folder, for stages travel; several with + between."""
    sha256: str
    format: str
    reader: str
    frame: str
    axes: str
    edits: tuple[str, ...]
    """What was done to the splats before, in this order, as it was asked for."""
    error_bounds: Mapping[str, str]
    notes: tuple[str, ...]


def provenance(
    sources: Sequence[Path],
    sha256: str,
    capture: Capture,
    *,
    edits: Sequence[Edit] = (),
    form: Form,
    axes: str,
    notes: tuple[str, ...],
) -> Provenance:
    """Gather what is to be remembered of a capture that was read from `sources` and edited."""
    return Provenance(
        source=" + ".join(_whole(source).name for source in sources),
        sha256=sha256,
        format=capture.format,
        reader=f"usdsplat {__version__}",
        frame=capture.frame,
        axes=axes,
        edits=tuple(map(str, edits)),
        error_bounds=joined_bounds(capture.error_bounds, schema.error_bounds(form)),
        notes=notes,
    )


def record(prim: Usd.Prim, memory: Provenance) -> None:
    """Write it to customData[KEY] of a field."""
    entry = asdict(memory)
    entry["error_bounds"] = dict(memory.error_bounds)
    for name in ("edits", "notes"):
        entry[name] = Vt.StringArray(list(entry[name]))
    prim.SetCustomDataByKey(KEY, entry)


def add_form(prim: Usd.Prim, form: Form) -> None:
    """Add what another form costs to the bounds that a prim remembers, if it remembers any."""
    entry = prim.GetCustomDataByKey(KEY)
    if isinstance(entry, dict):
        bounds = joined_bounds(entry.get("error_bounds", {}), schema.error_bounds(form))
        prim.SetCustomDataByKey(f"{KEY}:error_bounds", bounds)


def add_edits(prim: Usd.Prim, edits: Sequence[Edit]) -> None:
    """Add edits to those that a prim remembers, if it remembers where it came from."""
    entry = prim.GetCustomDataByKey(KEY)
    if isinstance(entry, dict):
        before = [str(text) for text in entry.get("edits", ())]
        texts = Vt.StringArray([*before, *map(str, edits)])
        prim.SetCustomDataByKey(f"{KEY}:edits", texts)
        bounds = bounds_after(entry.get("error_bounds", {}), edits)
        prim.SetCustomDataByKey(f"{KEY}:error_bounds", bounds)


def fingerprint(files: Sequence[Path]) -> str:
    """SHA-256 of a file; of several, over their names and fingerprints, sorted by name."""
    if len(files) == 1:
        return _digest(files[0])
    total = hashlib.sha256()
    for path in sorted(files):
        total.update(f"{path.name}\0{_digest(path)}\n".encode())
    return total.hexdigest()


def _digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _whole(source: Path) -> Path:
    """The folder of an unpacked SOG, which may be named by its meta.json; else the file."""
    return source.parent if source.name == "meta.json" else source


def joined_bounds(first: Mapping[str, str], second: Mapping[str, str]) -> dict[str, str]:
    """Bounds that add up, field by field; what has none stays so."""
    both = {name: [b[name] for b in (first, second) if name in b] for name in {*first, *second}}
    return {name: _sum(both[name]) for name in sorted(both)}


def _sum(bounds: Sequence[str]) -> str:
    """Of one field."""
    without = [bound for bound in bounds if bound.startswith(UNBOUNDED)]
    return without[0] if without else " + ".join(bounds)
