"""Options of conversions between captures and stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from usdsplat.formats import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions
from usdsplat.schema import Form

RATE = 24.0
"""[1/s] Frames of a sequence in a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How a capture becomes a splat field."""

    form: Form = "float"
    """How the field is stored, see `schema.author`."""
    axes: str | None = None
    """Where x, y and z of the capture point, such as "rdf"; None takes the file's own."""
    up_axis: str | None = None
    """"Y" or "Z" of a new file, "Y" if None; a stage has its own."""
    meters_per_unit: float | None = None
    """Metres in a unit of the capture, and of a new file; None is 1 for a new file and the stage's
    own for a stage."""
    prim_path: str | None = None
    """Path of the field; None is the file's name under the default prim."""
    bake_axes: bool = False
    """Turn the splats instead of authoring a transform op on the prim."""
    cameras: Path | str | None = None
    """Poses of the photographs that a capture was trained from, which become cameras beside the
    field, see `import_cameras`; edits that move the splats move them too. Not for sequences."""
    reading: ReadOptions = READ_OPTIONS
    """Options of the reader."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceOptions:
    """How captures with frame numbers become time samples."""

    frames: Sequence[float] | None = None
    """The frames to take, without gaps; None takes all."""
    clips: bool = False
    """Write value clips, a file for each frame in a folder `NAME.clips` beside the target, instead
    of time samples. Earlier clips there are replaced."""
    rate: float = RATE
    """[1/s] Frames in a second."""
    interpolate: bool = False
    """Treat row i as the same splat in all frames: it moves between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """How fields of a stage become captures."""

    time: float | None = None
    """Time code, see `export_capture`."""
    split: bool = False
    """Write each field to a capture of its own, see `export_each`."""
    writing: WriteOptions = WRITE_OPTIONS
    """Options of the writer."""


IMPORT, SEQUENCE, EXPORT = ImportOptions(), SequenceOptions(), ExportOptions()
