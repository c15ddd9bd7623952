"""Write a page that shows a stage or captures: one file, or a folder with `index.html`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pxr import Usd, UsdGeom, UsdLux, UsdVol

from usdsplat import formats, schema
from usdsplat.core.edits import Edit
from usdsplat.core.errors import OutputError, UnknownFormatError, UsageError
from usdsplat.core.folders import check_folder, made_folder
from usdsplat.core.output import is_private, output_file, output_group, write_output
from usdsplat.core.progress import Progress, silent
from usdsplat.core.text import shown
from usdsplat.core.wording import counted, said_bytes
from usdsplat.formats import WriteOptions, sog
from usdsplat.formats.sog.lod_meta import LOD_META
from usdsplat.interchange import files
from usdsplat.interchange.appearances import appearances
from usdsplat.interchange.authoring import prepare
from usdsplat.interchange.exporting import capture_of, export_report
from usdsplat.interchange.gathering import edit_capture, fitted
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.opening import open_capture
from usdsplat.interchange.options import (
    EXPORT,
    IMPORT,
    ExportOptions,
    ImportOptions,
    StageReading,
)
from usdsplat.interchange.reports import ExportReport
from usdsplat.interchange.streamed import is_streamed
from usdsplat.interchange.streamed_writing import write_streamed
from usdsplat.interchange.tree_reading import LEAVES
from usdsplat.interchange.unapplied import unapplied
from usdsplat.products.page.camera import AXES, PageCamera, PageRequest, page_camera
from usdsplat.products.page.document import VIEWER, VIEWER_FILES, Document
from usdsplat.products.page.settings import viewer_settings
from usdsplat.schema.composition import composition_findings
from usdsplat.schema.stage_values import in_world, may_move
from usdsplat.sim.stage.collections import find_simulations, splats
from usdsplat.sim.stage.provenance import KEY

INDEX = "index.html"
"""Name of the page of a folder."""
CAPTURE = "scene.sog"
STREAMED = "scene"
"""Folder of a streamed SOG beside the page."""
META_FILES = (LOD_META, "meta.json")
"""Files that have the same name in each folder of a capture."""
UNNAMED = "capture"
"""Title of what has no name."""
LARGE = 100_000_000
"""Size from which on a page in one file has a note [byte]."""
PAGE = PageRequest()


@dataclass(frozen=True, slots=True, kw_only=True)
class PageReport(ExportReport):
    """Report of a page."""

    camera: str
    """Path of the camera; "" for an automatic one."""
    frames: tuple[float, ...]
    """Time codes of the camera's animation; one if it does not move."""
    rate: float
    """Time codes per second."""
    files: tuple[str, ...]
    """The page, and what is beside it."""
    bytes: int
    """Size of all files."""


def write_page(
    source: Path | str | Usd.Stage | Sequence[Path | str],
    target: Path | str,
    *,
    request: PageRequest = PAGE,
    edits: Sequence[Edit] = (),
    options: ImportOptions = IMPORT,
    export: ExportOptions = EXPORT,
    progress: Progress = silent,
) -> PageReport:
    """Write a page for browsers that shows the splats of a stage, or captures.

    The page shows what `render` draws of splats with the same camera. Splats are those of one time;
    the camera moves.

    Args:
        source: A stage, a capture, or several captures, which are joined.
        target: `index.html` in a folder that is new or empty, which gets the viewer and the capture
            too; or another name ending in .html, of a file with everything inside.
        request: Camera, animation, title and background.
        edits: Edits in order, as for `convert`.
        options: Axes of captures, options of their reader, and the prim to read of a stage.
        export: Time and splat trees of a stage. `time` None is the first frame of its range.
            Without a choice, a folder gets all levels of splat trees as a streamed SOG.
        progress: Receives the progress of each step.

    Raises:
        UnknownFormatError: If the target's suffix is another.
        UsageError: If there is a stage among several inputs, or an option is invalid.
        StageError: If the stage cannot be opened, has no visible field, or no such camera.
        FormatError: If a capture is invalid.
        OutputError: If the target cannot be written, is a file of the source, or a folder is not
            empty.
    """
    path = Path(target)
    if not files.is_page(path):
        raise UnknownFormatError(str(path), f"suffix {path.suffix!r}", files.PAGE_SUFFIX)
    check_folder(path.parent)
    stage, name, inputs = _opened(source, options, edits, progress)
    files.check_not_input(path, inputs)
    is_stage = not isinstance(source, list | tuple) and not _is_capture(source)
    time = export.time
    if time is None and stage.HasAuthoredTimeCodeRange():
        time = stage.GetStartTimeCode()
    work = _Work(
        stage=stage,
        source=name,
        title=request.title or _title(source),
        target=path,
        reading=StageReading(
            prim_path=options.prim_path if is_stage else None,
            time=time,
            trees=export.trees,
            purposes=request.purposes,
        ),
        camera=page_camera(stage, request, time, is_capture=not is_stage),
        edits=tuple(edits) if is_stage else (),
        progress=progress,
    )
    return work.folder() if path.name.lower() == INDEX else work.file()


def _is_capture(source: Path | str | Usd.Stage) -> bool:
    return not isinstance(source, Usd.Stage) and not files.is_usd(Path(source))


def _title(source: Path | str | Usd.Stage | Sequence[Path | str]) -> str:
    """Return the title of a page: the names of the files, that of the folder for `META_FILES`, and
    `UNNAMED` for a stage in memory."""
    if isinstance(source, Usd.Stage):
        layer = source.GetRootLayer()
        return UNNAMED if layer.anonymous else Path(layer.realPath or layer.identifier).stem
    paths = [Path(source)] if isinstance(source, Path | str) else [Path(each) for each in source]
    return " + ".join(
        (each.absolute().parent.name if each.name in META_FILES else each.stem) or UNNAMED
        for each in paths
    )


def _opened(
    source: Path | str | Usd.Stage | Sequence[Path | str],
    options: ImportOptions,
    edits: Sequence[Edit],
    progress: Progress,
) -> tuple[Usd.Stage, str, list[Path]]:
    """Return the source as a stage, its name, and its files. Edits are applied to captures."""
    if isinstance(source, Usd.Stage):
        return source, source.GetRootLayer().identifier, files.layer_files(source)
    paths = [Path(source)] if isinstance(source, Path | str) else [Path(each) for each in source]
    name = " + ".join(map(str, paths))
    stages = [each for each in paths if files.is_usd(each)]
    if stages and len(paths) > 1:
        raise UsageError(str(stages[0]), "a stage among several inputs", "only captures")
    if stages:
        stage = files.open_stage(paths[0])
        return stage, name, files.layer_files(stage)
    if len(paths) == 1 and is_streamed(paths[0]) and not edits:
        return open_capture(paths[0], axes=options.axes, progress=progress), name, paths
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, None, None)
    how = replace(options, prim_path=None, cameras=None)
    import_capture(paths, stage, edits=edits, options=how, progress=progress)
    return stage, name, paths


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Work:
    """A page to write."""

    stage: Usd.Stage
    source: str
    title: str
    target: Path
    reading: StageReading
    camera: PageCamera
    edits: tuple[Edit, ...]
    progress: Progress

    def file(self) -> PageReport:
        """Write one file with everything inside."""
        data, report, antialiased = self._capture()
        document = self._document(antialiased)
        with (
            made_folder(self.target.parent),
            output_file(self.target) as output,
            output.open() as file,
        ):
            for part in document.parts(memoryview(data)):
                file.write(part)
            size = file.tell()
        notes = []
        if size > LARGE:
            notes.append(
                f"a page of {said_bytes(size)} in one file opens slowly: {INDEX} in a folder "
                "is for such captures"
            )
        return self._report(report, (self.target,), size, notes)

    def folder(self) -> PageReport:
        """Write a page with the viewer and the capture beside it."""
        folder = self.target.parent
        with made_folder(folder.parent), output_group() as group:
            earlier = len(group.moves)
            if not folder.exists():
                group.make_folder(folder)
            elif not all(is_private(each.name) for each in folder.iterdir()):
                found = "a folder with other files"
                raise OutputError(str(self.target), found, "a new or an empty folder")
            if self._streams():
                group.make_folder(folder / STREAMED)
                name, url = LOD_META, f"{STREAMED}/{LOD_META}"
                report, antialiased = self._streamed(folder / url)
            else:
                data, report, antialiased = self._capture()
                name = url = CAPTURE
                write_output(folder / CAPTURE, data)
            group.make_folder(folder / VIEWER.name)
            for each in VIEWER_FILES:
                write_output(folder / VIEWER.name / each, (VIEWER / each).read_bytes())
            document = self._document(antialiased, capture=name, url=url)
            write_output(self.target, b"".join(document.parts(memoryview(b""))))
            written = {move.final: move.made.stat().st_size for move in group.moves[earlier:]}
        note = (
            "browsers do not read files beside a page that is opened from disk: "
            "put the folder on a host, or write one file, such as page.html"
        )
        return self._report(report, sorted(written), sum(written.values()), [note])

    def _capture(self) -> tuple[bytes, ExportReport, bool]:
        """Return the splats as a SOG, its report, and whether they are antialiased."""
        capture, prims = capture_of(self.stage, AXES, self.reading, progress=self.progress)
        capture = edit_capture(capture, self.edits, progress=self.progress)
        capture = fitted(capture, Path(CAPTURE))
        how = WriteOptions(antialiased=capture.antialiased, frame=AXES, progress=self.progress)
        formats.check_finite(capture.cloud, self.target)
        data = sog.archive(capture.cloud, str(self.target), how)
        report = export_report(capture, prims, self.source, self.target, sog.ERROR_BOUNDS)
        findings = (*composition_findings(self.stage), *unapplied(prims, self.reading.time))
        return data, replace(report, findings=findings), capture.antialiased

    def _streams(self) -> bool:
        """Return whether the splats are those of trees, of which all levels are written."""
        if self.edits or self.reading.trees != LEAVES:
            return False
        found, _ = appearances(self.stage, self.reading)
        return all(item.trees for item in found)

    def _streamed(self, target: Path) -> tuple[ExportReport, bool]:
        """Write a streamed SOG; return its report, and whether its splats are antialiased."""
        report = write_streamed(self.stage, target, self.reading, progress=self.progress)
        modes = {item.rasterize_mode for item in appearances(self.stage, self.reading)[0]}
        return replace(report, source=self.source), modes == {"antialiased"}

    def _document(self, antialiased: bool, *, capture: str = CAPTURE, url: str = "") -> Document:
        settings, ups = viewer_settings(self.camera)
        return Document(
            title=shown(self.title),
            settings=settings,
            ups=ups,
            aspect=self.camera.aspect,
            antialiased=antialiased,
            capture=capture,
            url=url,
        )

    def _report(
        self, report: ExportReport, written: Sequence[Path], size: int, notes: Sequence[str]
    ) -> PageReport:
        """Return the report of the page."""
        return PageReport(
            source=report.source,
            target=str(self.target),
            prim_paths=report.prim_paths,
            splats=report.splats,
            degree=report.degree,
            frame=report.frame,
            error_bounds=report.error_bounds,
            notes=(*report.notes, *self.camera.notes, *self._left_out(report), *notes),
            findings=(*report.findings, *self.camera.findings),
            camera=self.camera.path,
            frames=self.camera.frames,
            rate=self.camera.rate,
            files=tuple(map(str, written)),
            bytes=size,
        )

    def _left_out(self, report: ExportReport) -> list[str]:
        """Return notes on what the stage has and the page has not."""
        prims = [self.stage.GetPrimAtPath(path) for path in report.prim_paths]
        moving = [prim for prim in prims if _moves(prim)]
        notes = []
        if moving:
            when = (
                "the default time" if self.reading.time is None else f"frame {self.reading.time:g}"
            )
            notes.append(
                f"the page shows {when}: the animation of {counted(len(moving), 'field')} is not "
                "in it"
            )
        everything = list(in_world(self.stage))
        if surfaces := sum(map(_is_surface, everything)):
            notes.append(f"the page has only splats, without {counted(surfaces, 'surface')}")
        if lights := sum(prim.HasAPI(UsdLux.LightAPI) for prim in everything):
            notes.append(f"the page has the captured light, without {counted(lights, 'light')}")
        for simulation in find_simulations(self.stage):
            fields, _ = splats(self.stage, simulation)
            if not all(map(_is_baked, fields)):
                notes.append(
                    f"the page has nothing of the simulation {simulation.GetPath()}, which is not "
                    "baked: bake it, and write the page of the bake"
                )
        return notes


def _is_surface(prim: Usd.Prim) -> bool:
    """Return whether a prim is drawn as something else than splats."""
    return bool(prim.IsA(UsdGeom.Gprim)) and not prim.IsA(UsdVol.ParticleField)


def _is_baked(prim: Usd.Prim) -> bool:
    """Return whether the splats of a prim are those of a bake."""
    return prim.GetCustomDataByKey(":".join(KEY)) is not None


def _moves(prim: Usd.Prim) -> bool:
    """Return whether the splats of a prim change over time, as far as USD tells."""
    if schema.is_splat_field(prim) and schema.is_time_varying(prim):
        return True
    while prim and not prim.IsPseudoRoot():
        if may_move(prim):
            return True
        prim = prim.GetParent()
    return False
