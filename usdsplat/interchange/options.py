"""Options of conversions between captures and stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from usdsplat.formats import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions
from usdsplat.interchange.tree_reading import LEAVES, TreeChoice
from usdsplat.schema import Form

RATE = 24.0
"""Default frame rate of a sequence [1/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options for importing a capture as a splat field."""

    form: Form = "float"
    """Storage form of the field, see `schema.author`."""
    axes: str | None = None
    """Axes of the capture, such as "rdf"; None or "auto" chooses them: the file's, else those that
    the splats show, else "rdf"."""
    up_axis: str | None = None
    """Up axis of a new file, "Y" or "Z"; None is "Y" for a file, and the stage's own for a
    stage."""
    meters_per_unit: float | None = None
    """Metres per unit of the capture and of a new file. None is 1 for a new file; a capture that
    states no unit then has the stage's."""
    prim_path: str | None = None
    """Path of the field; None is `splats` below a model named like the file, which is below the
    default prim, or at the root of a stage without one."""
    bake_axes: bool = False
    """Transform the splats instead of authoring a transform op on the prim."""
    cameras: Path | str | None = None
    """Poses of the photographs of a capture, imported as cameras beside the field, see
    `import_cameras`; edits that move the splats move them too. Not for sequences."""
    reading: ReadOptions = READ_OPTIONS
    """Options of the reader."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceOptions:
    """Options for importing captures with frame numbers as time samples."""

    frames: Sequence[float] | None = None
    """Frames to import, without gaps; None is all."""
    clips: bool = False
    """Write value clips, a file for each frame in a folder `NAME.clips` beside the target, instead
    of time samples. Earlier clips there are replaced."""
    rate: float = RATE
    """Frame rate [1/s]."""
    interpolate: bool = False
    """Whether row i is the same splat in all frames, so that it is interpolated between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """Options for exporting fields of a stage as captures."""

    time: float | None = None
    """Time code, see `export_capture`."""
    split: bool = False
    """Whether to write each field to a separate capture, see `export_each`."""
    writing: WriteOptions = WRITE_OPTIONS
    """Options for writing the capture file, such as the SPZ version."""
    trees: TreeChoice = LEAVES
    """What to read of splat trees."""
    trees_at: Mapping[float, TreeChoice] = field(default_factory=dict)
    """The same for frames of a sequence; `trees` is for the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageReading:
    """Which splats of a stage are read for a capture."""

    prim_path: str | None = None
    """A field, or a prim with fields below it; None is the whole stage."""
    time: float | None = None
    """Time code, see `export_capture`."""
    trees: TreeChoice = LEAVES
    """What to read of splat trees."""
    purposes: tuple[str, ...] = ("default", "render")
    """Purposes of prims that count as visible."""


IMPORT, SEQUENCE, EXPORT = ImportOptions(), SequenceOptions(), ExportOptions()
