"""Read the visible fields and splat trees of a stage in parts, in world space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from pxr import Usd

from usdsplat import schema
from usdsplat.core import edit
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Progress
from usdsplat.interchange import files
from usdsplat.interchange.appearances import Appearance, appearances
from usdsplat.interchange.decimating import FAR_LINES, framing_pixel
from usdsplat.interchange.exporting import unknown_color_spaces
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.sources import check_memory, splat_bytes
from usdsplat.interchange.lod.survey import SAMPLED, Survey, core_box
from usdsplat.interchange.lod.tree_rows import TreeRows
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.outliers import weighted_median
from usdsplat.interchange.placement import stage_frame
from usdsplat.interchange.unapplied import unapplied
from usdsplat.schema import attributes, packing, registration, tokens
from usdsplat.schema.composition import composition_findings
from usdsplat.schema.stage_values import stage_unit
from usdsplat.schema.tree_cuts import TreeReading

_BLOCK = 1 << 20  # centres transformed at a time


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Part:
    """A field or a tree at one of the places where it appears."""

    item: Appearance
    to_world: F64
    """Shape (4, 4)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Fields:
    """The visible fields and trees of an open stage."""

    stage: Usd.Stage
    items: tuple[Appearance, ...]
    parts: tuple[_Part, ...]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, path: Path, options: LodOptions) -> _Fields:
        """Open a stage and find its fields."""
        stage = files.open_stage(path)
        found, notes = appearances(stage, StageReading(time=options.time))
        for item in found:
            if item.trees:
                item.trees[0].check_chunks()  # the same for all places
                if not len(item.trees[0]):
                    where = f"{path} {item.prim.GetPath()}"
                    raise StageError(where, "a splat tree without splats", "at least one")
        return cls(
            stage=stage,
            items=tuple(found),
            parts=tuple(_Part(item=a, to_world=m) for a in found for m in a.to_world),
            notes=tuple(notes),
        )

    @property
    def prims(self) -> list[Usd.Prim]:
        """The prims of the fields and trees."""
        return [item.prim for item in self.items]


class StageSource:
    """The visible fields and trees of a stage. Packed fields are decoded in parts; of trees, only
    leaves and residents are read, in parts.

    Raises:
        StageError: If the stage cannot be opened, or has no visible field or tree, or a chunk of a
            tree is missing or does not fit it.
    """

    def __init__(self, path: Path, options: LodOptions) -> None:
        self.path = path
        self._options = options
        self._opened: _Fields | None = None
        self._read: tuple[Appearance, _FieldRows | _TreeField] | None = None
        fields = self._fields
        chunks = (Path(each) for item in fields.items for each in item.chunk_files if each)
        self.files: tuple[Path, ...] = (*files.layer_files(fields.stage), *chunks)

    @property
    def _fields(self) -> _Fields:
        """The opened stage; opened again after `release`."""
        if self._opened is None:
            self._opened = _Fields.of(self.path, self._options)
        return self._opened

    def survey(self, progress: Progress) -> Survey:
        """Read the centres of all fields and trees, and a sample of their splats."""
        stage, parts, prims = self._fields.stage, self._fields.parts, self._fields.prims
        counts, degrees, pixels = [], [], []
        boxes: list[tuple[F64, F64]] = []
        sampled: list[SplatCloud] = []
        for done, part in enumerate(parts):
            progress.step("reading fields", done, len(parts))
            field = self._field(part.item)
            few, around = field.sample(part.to_world)
            few = edit.prune(_placed(part, few, np.eye(4)))
            counts.append(field.count)
            degrees.append(few.sh_degree)
            pixels.append(_pixel(part, few))
            boxes += around
            sampled.append(few)
        progress.step("reading fields", len(parts), len(parts))
        low, high, core = np.zeros(3), np.zeros(3), (np.zeros(3), np.zeros(3))
        centres = np.concatenate([cloud.positions for cloud in sampled])
        if boxes and len(centres):
            low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
            core = core_box(centres)
        spaces = sorted({schema.color_space(prim) for prim in prims})
        modes = {schema.rasterize_mode(prim) for prim in prims}
        footprints = [_footprint(part) or 0.0 for part in parts]
        survey = Survey(
            name=str(self.path),
            files=tuple(map(str, self.files)),
            parts=tuple(counts),
            degree=max(degrees),
            low=tuple(map(float, low)),
            high=tuple(map(float, high)),
            core_low=tuple(map(float, core[0])),
            core_high=tuple(map(float, core[1])),
            pixel=weighted_median(np.array(pixels), np.array(counts)) if sum(counts) else 0.0,
            frame=stage_frame(stage),
            frame_source="file",
            frame_score=0.0,
            meters_per_unit=stage_unit(stage),
            unit_source="file",
            antialiased=modes == {"antialiased"},
            projection_modes=tuple(sorted(set(map(schema.projection_mode, prims)))),
            sorting_modes=tuple(sorted(set(map(schema.sorting_mode, prims)))),
            footprints=(min(footprints), max(footprints)),
            color_space=spaces[0],
            format="USD",
            error_bounds={},
            notes=(
                *self._fields.notes,
                *unknown_color_spaces(prims),
                *_mixed(spaces),
                *_dropped_arrays(prims),
            ),
        )
        self.release()
        return survey

    def rows(self, part: int, first: int, last: int, matrix: F64) -> SplatCloud:
        """Return some splats of a field at one of its places."""
        found = self._fields.parts[part]
        own = self._field(found.item).rows(slice(first, last))
        return _placed(found, own, matrix)

    def findings(self) -> list[Finding]:
        """Return problems of composition, and the grades, crops and light that a tree does not
        get."""
        fields = self._fields
        return [*composition_findings(fields.stage), *unapplied(fields.prims, self._options.time)]

    def release(self) -> None:
        """Close the stage: what is read of its files stays in memory with it."""
        self._opened = self._read = None

    def _field(self, item: Appearance) -> _FieldRows | _TreeField:
        """Return the reader of a field or a tree; the last one is kept."""
        if self._read is None or self._read[0] is not item:
            self._read = None
            tree = item.trees[0] if item.trees else None
            reader = _FieldRows(item.prim, self._options) if tree is None else _TreeField(tree)
            self._read = item, reader
        return self._read[1]


class _TreeField:
    """Reader of the splats of a tree, in its own coordinates."""

    def __init__(self, reading: TreeReading) -> None:
        tree = reading.tree
        self._rows = TreeRows(tree.table, tree.reader())
        self.count = self._rows.count
        """Number of splats."""

    def rows(self, rows: slice) -> SplatCloud:
        """Return some splats that follow each other."""
        return self._rows.rows(rows.start, rows.stop)

    def sample(self, matrix: F64) -> tuple[SplatCloud, list[tuple[F64, F64]]]:
        """Return some splats, and boxes around all centres in the world."""
        few, boxes = [], []
        for some, centres in self._rows.sample():
            few.append(some)
            boxes += _world_boxes(centres, matrix)
        return edit.merge(few), boxes


class _FieldRows:
    """Reader of rows of a field, in its own coordinates."""

    def __init__(self, prim: Usd.Prim, options: LodOptions) -> None:
        self._prim, self._time = prim, options.time
        self._packed: packing.PackedArrays | None = None
        where = str(prim.GetPath())
        if schema.is_packed(prim):
            registration.require(where)
        try:
            code = attributes.time_code(prim, options.time)
            name = tokens.POSITIONS
            if not schema.is_packed(prim):
                name = name if attributes.length(prim, name, code) else tokens.POSITIONS_HALF
            self.positions: F32 = attributes.centres(prim, name, code, options.time)[0]
            if schema.is_packed(prim):
                self._packed = schema.fetch_packed(prim, options.time)
        except UsdSplatError:
            raise
        except (TypeError, ValueError, OverflowError) as error:
            found = f"attributes of other types than the schema's ({error})"
            raise StageError(where, found, "those of the schema") from error
        if self._packed is None:
            degree = min(max(attributes.degree(prim, code), 0), 4)
            check_memory(where, len(self.positions) * splat_bytes(degree), options.memory_limit)
            self.positions = self._whole.positions

    @property
    def count(self) -> int:
        """Number of splats."""
        return len(self.positions)

    def rows(self, rows: slice) -> SplatCloud:
        """Return some splats, without ids and velocities."""
        arrays = self._packed
        if arrays is None:
            whole = self._whole
            return SplatCloud(
                positions=whole.positions[rows],
                scales=np.abs(whole.scales[rows]),
                rotations=whole.rotations[rows],
                opacities=whole.opacities[rows],
                sh=whole.sh[rows],
            )
        width = 4 * packing.harmonics_width(arrays.degree)
        harmonics = arrays.harmonics.reshape(-1, width)[rows] if width else arrays.harmonics
        part = replace(arrays, core=arrays.core[rows], harmonics=harmonics.reshape(-1, 4))
        return packing.unpack(self.positions[rows], part)

    def sample(self, matrix: F64) -> tuple[SplatCloud, list[tuple[F64, F64]]]:
        """Return some splats, and boxes around all centres in the world."""
        few = self.rows(slice(0, self.count, max(1, self.count // SAMPLED)))
        blocks = range(0, self.count, _BLOCK)
        centres = (self.positions[first : first + _BLOCK] for first in blocks)
        return few, [box for here in centres for box in _world_boxes(here, matrix)]

    @cached_property
    def _whole(self) -> SplatCloud:
        """The decoded field."""
        return schema.fetch(self._prim, self._time)


def _world_boxes(centres: F32, matrix: F64) -> list[tuple[F64, F64]]:
    """Return the box around the finite centres in the world, or nothing if there is none."""
    points = centres[np.isfinite(centres).all(axis=1)] @ matrix[:3, :3].T + matrix[:3, 3]
    return [(points.min(axis=0), points.max(axis=0))] if len(points) else []


def _placed(part: _Part, own: SplatCloud, matrix: F64) -> SplatCloud:
    """Return splats of a field in the world, transformed by `matrix`.

    Raises:
        StageError: If the transform is not finite, or float32 cannot hold the result.
    """
    where, total = str(part.item.prim.GetPath()), matrix @ part.to_world
    if not np.isfinite(total).all():
        raise StageError(where, "a transform that is not finite", "finite numbers")
    placed = edit.transform(own, total)
    if edit.overflows(own, placed):
        found = "splats beyond the float32 range in world space"
        raise StageError(where, found, "a smaller transform")
    return placed


def _pixel(part: _Part, few: SplatCloud) -> float:
    """Return the size of a pixel of the photographs in the world, authored or estimated."""
    return _footprint(part) or framing_pixel(few, FAR_LINES)


def _footprint(part: _Part) -> float | None:
    """Return the authored footprint of a field or tree in the world; None if it has none."""
    authored = schema.footprint(part.item.prim)
    if authored is None:
        return None
    return float(authored * np.cbrt(abs(np.linalg.det(part.to_world[:3, :3]))))


def _dropped_arrays(prims: Sequence[Usd.Prim]) -> list[str]:
    """Return a note if fields have ids or velocities, which a tree does not keep."""
    found = [
        name
        for name in (tokens.IDS, tokens.VELOCITIES)
        if any((own := prim.GetAttribute(name)) and own.HasAuthoredValue() for prim in prims)
    ]
    return [f"{' and '.join(found)} of fields are not kept"] if found else []


def _mixed(spaces: list[str]) -> list[str]:
    """Return a note on fields of a stage with different colour spaces."""
    if len(spaces) == 1:
        return []
    return [f"colours are in {' and '.join(spaces)}; the tree states {spaces[0]} for all splats"]
