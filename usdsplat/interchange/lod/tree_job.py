"""The building of a tree whose inputs are surveyed: its steps, its stage and its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import cast

from pxr import Sdf, Usd, UsdGeom

from usdsplat import __version__, schema
from usdsplat.core import axes
from usdsplat.core.errors import StageError
from usdsplat.core.node_table import NodeTable
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange import files
from usdsplat.interchange.authoring import axes_text, prepare
from usdsplat.interchange.gathering import widened
from usdsplat.interchange.lod.chunks import ChunkForm, chunk_name
from usdsplat.interchange.lod.coarse import COARSE, ROOT, referring, write_coarse
from usdsplat.interchange.lod.coarse import FILE as COARSE_FILE
from usdsplat.interchange.lod.measuring import ErrorMeter
from usdsplat.interchange.lod.nodes import NodeBuilder, chunk_numbers
from usdsplat.interchange.lod.options import LodOptions, LodReport
from usdsplat.interchange.lod.partition import Branch, partition
from usdsplat.interchange.lod.placing import TreeFiles
from usdsplat.interchange.lod.runs import Runs
from usdsplat.interchange.lod.sorting import sort_inputs
from usdsplat.interchange.lod.sources import Source, splat_bytes
from usdsplat.interchange.lod.survey import Meeting, Survey, meet
from usdsplat.interchange.lod.tables import assemble
from usdsplat.interchange.lod.work_folder import WorkFolder
from usdsplat.interchange.models import FIELD, author_model
from usdsplat.interchange.placement import (
    Placement,
    define_ancestors,
    identifier,
    placement,
    set_default_prim,
    set_op,
)
from usdsplat.interchange.provenance import Provenance, fingerprint, joined_bounds, record
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.render.specs import RasterizeMode
from usdsplat.schema.lod_root_authoring import name_lod_root
from usdsplat.schema.packing import harmonics_width
from usdsplat.schema.stage_values import stage_unit, up_axis
from usdsplat.schema.tree import author_digests, author_tree


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TreeJob:
    """The building of a tree whose inputs are surveyed."""

    inputs: Sequence[Source]
    surveys: Sequence[Survey]
    meeting: Meeting
    folder: WorkFolder
    options: LodOptions

    @classmethod
    def prepared(
        cls,
        inputs: Sequence[Source],
        folder: WorkFolder,
        options: LodOptions,
        progress: Progress,
    ) -> TreeJob:
        """Survey the inputs, or take the stored surveys."""
        surveys = folder.surveys()
        if surveys is None:
            surveys, held = [], 0
            for done, each in enumerate(inputs):
                progress.step("reading inputs", done, len(inputs))
                surveys.append(each.survey(progress if len(inputs) == 1 else silent))
                held += surveys[-1].count * splat_bytes(surveys[-1].degree)
                if held > options.memory_limit // 4:
                    each.release()
            meet(surveys, sh_degree=options.sh_degree, pixel=options.pixel)
            folder.store(surveys)
        meeting = meet(surveys, sh_degree=options.sh_degree, pixel=options.pixel)
        return cls(inputs=inputs, surveys=surveys, meeting=meeting, folder=folder, options=options)

    def build(self, tree_files: TreeFiles, progress: Progress) -> LodReport:
        """Build the tree and return the report, without findings."""
        meeting, folder, options = self.meeting, self.folder, self.options
        stage, placed = self.stage()
        runs, dropped = sort_inputs(
            self.inputs, self.surveys, meeting, folder, options.memory_limit, progress
        )
        if not runs.counts.sum():
            raise StageError(self.surveys[0].name, "no splat that can be drawn", "one or more")
        root = partition(runs, options.leaf_splats)
        runs.unmap()
        device = open_device(task="geometry")
        self.builder(runs, root, stage, device, progress).build()
        table, sizes, digests = assemble(root, folder.chunks)
        meter = ErrorMeter(
            table=table,
            sizes=sizes,
            folder=folder.chunks,
            degree=meeting.degree,
            pixel=meeting.pixel,
            captured_mode=cast(RasterizeMode, meeting.drawing.rasterize_mode),
            device=device,
        )
        table = replace(table, errors=meter.errors(progress))
        notes = list(meeting.notes)
        if dropped:
            why = "a number is not finite or the rotation is zero"
            notes.append(f"splats dropped because {why}: {dropped}")
        progress.step("writing", 0, 1)
        chunks = [folder.chunks / chunk_name(n) for n in range(len(chunk_numbers(root)) + 1)]
        coarse = write_coarse(
            folder.chunks / COARSE_FILE,
            table,
            chunks,
            self._form(stage),
            degree=meeting.degree,
        )
        prim = self._authored(stage, placed, table, digests, tree_files, notes)
        layer = referring(
            stage.GetRootLayer(),
            prim.GetPath().ReplaceName(COARSE),
            tree_files.asset(COARSE_FILE),
        )
        tree_files.place(layer, [*chunks, folder.chunks / COARSE_FILE])
        progress.step("writing", 1, 1)
        return self._report(prim, placed, table, tree_files, coarse, notes)

    def builder(
        self, runs: Runs, root: Branch, stage: Usd.Stage, device: Device, progress: Progress
    ) -> NodeBuilder:
        """Return the maker of the chunks."""
        done, total = 0, root.span.count

        def told(splats: int) -> None:
            nonlocal done
            done += splats
            progress.step("building levels", done, total)

        told(0)
        return NodeBuilder(
            runs=runs,
            root=root,
            folder=self.folder.chunks,
            form=self._form(stage),
            pixel=self.meeting.pixel,
            most=self.options.leaf_splats,
            device=device,
            told=told,
        )

    def stage(self) -> tuple[Usd.Stage, Placement]:
        """Return a stage for the tree, and the map from the tree's coordinates to it."""
        first, options = self.surveys[0], self.options
        own = {frame: axis for axis, frame in axes.UP_AXIS_FRAME.items()}
        up = own.get(first.frame, "Y") if files.is_usd(self.inputs[0].path) else "Y"
        unit = options.meters_per_unit or self.meeting.meters_per_unit
        stage = Usd.Stage.CreateInMemory()
        prepare(stage, options.up_axis or up, unit)
        return stage, placement(stage, self.meeting.frame, self.meeting.meters_per_unit)

    def _form(self, stage: Usd.Stage) -> ChunkForm:
        """Return what all chunks have in common."""
        return ChunkForm(
            up_axis=up_axis(stage),
            meters_per_unit=stage_unit(stage),
            color_space=self.meeting.color_space,
            drawing=self.meeting.drawing,
        )

    def _authored(
        self,
        stage: Usd.Stage,
        placed: Placement,
        table: NodeTable,
        digests: Sequence[str],
        tree_files: TreeFiles,
        notes: Sequence[str],
    ) -> Usd.Prim:
        """Author the prims of the tree, and beside them the prim of its coarse levels. Return the
        prim of the tree."""
        model = Sdf.Path.absoluteRootPath.AppendChild(identifier(tree_files.target.stem))
        path = model.AppendChild(FIELD)
        chunks = [tree_files.asset(chunk_name(n)) for n in range(int(table.chunk.max()) + 1)]
        define_ancestors(stage, path)
        prim = author_tree(
            stage,
            path,
            table,
            chunks,
            degree=self.meeting.degree,
            color_space=self.meeting.color_space,
            drawing=self.meeting.drawing,
            pixel=self.meeting.pixel,
        )
        author_digests(prim, digests)
        beside = UsdGeom.Xform.Define(stage, path.ReplaceName(COARSE)).GetPrim()
        for each in (prim, beside):
            set_op(each, placed.matrix)
        name_lod_root(prim, beside.GetPath().AppendChild(ROOT))
        set_default_prim(stage, path)
        author_model(prim, tree_files.target)
        record(prim, self._provenance(stage, placed, notes))
        return prim

    def _provenance(self, stage: Usd.Stage, placed: Placement, notes: Sequence[str]) -> Provenance:
        """Return the record of the origin of the tree."""
        first = self.surveys[0]
        unit = self.meeting.meters_per_unit
        files_read = dict.fromkeys(file for each in self.surveys for file in each.files)
        return Provenance(
            source=" + ".join(each.path.name for each in self.inputs),
            sha256=fingerprint([Path(file) for file in files_read]),
            format=" + ".join(dict.fromkeys(each.format for each in self.surveys)),
            reader=f"usdsplat {__version__}",
            frame=self.meeting.frame,
            frame_source=self.meeting.frame_source,
            frame_score=None,
            axes=axes_text(placed, baked=False),
            meters_per_unit=stage_unit(stage) if unit is None else unit,
            unit_source="assumed" if unit is None else first.unit_source,
            sh_degree=self.meeting.degree,
            edits=(),
            error_bounds=self._error_bounds(),
            notes=tuple(notes),
        )

    def _error_bounds(self) -> dict[str, str]:
        """Return the maximum error of the splats of leaves, by field of the cloud."""
        bounds: list[Mapping[str, str]] = [each.error_bounds for each in self.surveys]
        read = reduce(widened, bounds)
        return joined_bounds(read, schema.error_bounds("packed"))

    def _report(
        self,
        prim: Usd.Prim,
        placed: Placement,
        table: NodeTable,
        tree_files: TreeFiles,
        coarse: tuple[int, ...],
        notes: Sequence[str],
    ) -> LodReport:
        """Return the report of a tree that is in place."""
        leaves = table.child_count == 0
        splats = int(table.proxies[leaves].sum() + table.residents.sum())
        errors = table.errors[~leaves]
        return LodReport(
            sources=tuple(str(each.path) for each in self.inputs),
            target=str(tree_files.target),
            prim_path=str(prim.GetPath()),
            splats=splats,
            degree=self.meeting.degree,
            nodes=len(table),
            leaves=int(leaves.sum()),
            levels=len(table.levels()),
            chunks=int(table.chunk.max()) + 1,
            residents=int(table.residents.sum()),
            size=sum(
                (tree_files.folder / chunk_name(number)).stat().st_size
                for number in range(int(table.chunk.max()) + 1)
            ),
            coarse=coarse,
            coarse_size=(tree_files.folder / COARSE_FILE).stat().st_size,
            leaf_size=splats * (28 + 16 * harmonics_width(self.meeting.degree)),
            pixel=self.meeting.pixel,
            errors=(float(errors.min()), float(errors.max())) if len(errors) else (0.0, 0.0),
            frame=self.meeting.frame,
            axes=axes_text(placed, baked=False),
            meters_per_unit=stage_unit(prim.GetStage()),
            continued=self.folder.is_continued,
            error_bounds=self._error_bounds(),
            notes=tuple(notes),
        )
