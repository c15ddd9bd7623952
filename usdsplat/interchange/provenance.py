"""Record the origin of a field on its prim."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pxr import Usd, Vt

from usdsplat import __version__, schema
from usdsplat.core.edits import Edit
from usdsplat.core.text import shown
from usdsplat.formats import Capture
from usdsplat.interchange.editing import UNBOUNDED, bounds_after
from usdsplat.schema import Form

KEY = "usdsplat"
"""Key of the dictionary in the prim's customData."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Record of an import."""

    source: str
    """File name without its folder, because stages are moved; several are joined by +."""
    sha256: str
    format: str
    reader: str
    frame: str
    frame_source: str
    """Source of the axes: "given", "file", "evidence" or "assumed"."""
    frame_score: float | None
    """Score of the evidence, if that is the source."""
    axes: str
    meters_per_unit: float
    """Unit of the capture; the stage's if `unit_source` is "assumed"."""
    unit_source: str
    """Source of the unit: "given", "file" or "assumed"."""
    sh_degree: int
    """Degree of the harmonics as imported."""
    edits: tuple[str, ...]
    """Edits in order, as requested."""
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
    """Return the record of a capture that was read from `sources`, edited, and has a unit."""
    assert capture.meters_per_unit is not None  # an assumed one if the file states none
    return Provenance(
        source=" + ".join(_whole(source).name for source in sources),
        sha256=sha256,
        format=capture.format,
        reader=f"usdsplat {__version__}",
        frame=capture.frame,
        frame_source=capture.frame_source,
        frame_score=capture.frame_score,
        axes=axes,
        meters_per_unit=capture.meters_per_unit,
        unit_source=capture.unit_source,
        sh_degree=capture.cloud.sh_degree,
        edits=tuple(map(str, edits)),
        error_bounds=joined_bounds(capture.error_bounds, schema.error_bounds(form)),
        notes=notes,
    )


def record(prim: Usd.Prim, memory: Provenance) -> None:
    """Write the record to customData[KEY] of a field."""
    entry = {name: value for name, value in asdict(memory).items() if value is not None}
    entry["error_bounds"] = dict(memory.error_bounds)
    entry["source"] = shown(memory.source)
    for name in ("edits", "notes"):
        entry[name] = Vt.StringArray([shown(text) for text in entry[name]])
    prim.SetCustomDataByKey(KEY, entry)


def add_form(prim: Usd.Prim, form: Form) -> None:
    """Add the error bounds of a storage form to the record of a prim, if it has one."""
    entry = prim.GetCustomDataByKey(KEY)
    if isinstance(entry, dict):
        bounds = joined_bounds(entry.get("error_bounds", {}), schema.error_bounds(form))
        prim.SetCustomDataByKey(f"{KEY}:error_bounds", bounds)


def add_edits(prim: Usd.Prim, edits: Sequence[Edit]) -> None:
    """Add edits to the record of a prim, if it has one."""
    entry = prim.GetCustomDataByKey(KEY)
    if isinstance(entry, dict):
        before = [str(text) for text in entry.get("edits", ())]
        texts = Vt.StringArray([*before, *map(str, edits)])
        prim.SetCustomDataByKey(f"{KEY}:edits", texts)
        bounds = bounds_after(entry.get("error_bounds", {}), edits)
        prim.SetCustomDataByKey(f"{KEY}:error_bounds", bounds)


def fingerprint(files: Sequence[Path]) -> str:
    """Return the SHA-256 of a file; of several, over their names and hashes, sorted by name."""
    if len(files) == 1:
        return _digest(files[0])
    total = hashlib.sha256()
    for path in sorted(files):
        total.update(f"{path.name}\0{_digest(path)}\n".encode())
    return total.hexdigest()


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _whole(source: Path) -> Path:
    """Return the folder of an unpacked SOG given by its meta.json, else the file."""
    return source.parent if source.name == "meta.json" else source


def joined_bounds(first: Mapping[str, str], second: Mapping[str, str]) -> dict[str, str]:
    """Add error bounds, field by field."""
    both = {name: [b[name] for b in (first, second) if name in b] for name in {*first, *second}}
    return {name: _sum(both[name]) for name in sorted(both)}


def _sum(bounds: Sequence[str]) -> str:
    """Add the bounds of one field."""
    without = [bound for bound in bounds if bound.startswith(UNBOUNDED)]
    return without[0] if without else " + ".join(bounds)
