"""Turn captures into a stage, stages into a capture, or either into another of its kind.

examples:
  usdsplat convert scan.ply scan.usdc
      a stage with one splat field, turned upright by a transform on the prim
  usdsplat convert scan.spz scan.usdc --up-axis Z --meters-per-unit 0.01 --frame rub
      for a Z-up pipeline; the capture is in centimetres and its y points up
  usdsplat convert scan.ply scan.usdc --packed
      a third of the size, in the compact type that needs usdsplat to be drawn
  usdsplat convert shot.usd still.ply --time 12 --prim /World/Tree
      what is beneath a prim at frame 12, in world space, as a capture
  usdsplat convert shot.usd tree.spz --split
      each field a file of its own: tree_Trunk.spz, tree_Leaves.spz
  usdsplat convert house.ply garden.sog both.ply
      several captures in one, in the coordinates of the first
  usdsplat convert scan.ply --rotate 0,0,180 --crop-sphere 0,0,0,5 --min-opacity 0.02 clean.ply
      turned, then cut, then thinned: edits are done in the order in which they are typed

notes:
  A frame is where x, y and z point: rdf is right, down, forward, as in most captures.
  Edits act on the numbers of a capture, as 'usdsplat info' prints them. Of a stage they act on
  the capture that it becomes; from stage to stage, on the numbers of each field and sample.
  Inputs are only read; the output appears when it is complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, create_mutex_group

from usdsplat.cli import console, edit_flags
from usdsplat.cli.edit_flags import EditFlags, edits_of
from usdsplat.cli.parsing import option
from usdsplat.cli.values import time_code
from usdsplat.core.errors import UsageError
from usdsplat.core.wording import counted

if TYPE_CHECKING:
    from usdsplat.interchange.converting import Report
    from usdsplat.schema import Form

_MEANINGFUL = {
    (False, True): (
        *("packed", "half", "up_axis", "frame", "meters_per_unit", "prim", "bake_axes", "lod"),
    ),
    (True, False): ("prim", "frame", "time", "split", "spz_version"),
    (False, False): ("frame", "lod", "spz_version"),
    (True, True): ("packed", "half"),
}
"""Whether input and output are stages -> the flags that mean something."""
FORM = create_mutex_group(required=False, title="form")


@dataclass(frozen=True, slots=True, kw_only=True)
class StageWritten:
    """How a stage is written."""

    packed: Annotated[bool, FORM, option()] = False
    """store fields in our compact type: 28 bytes a splat at degree 0, 76 at degree 3"""
    half: Annotated[bool, FORM, option()] = False
    """store fields as stock half floats, centres as floats: 124 bytes a splat at degree 3"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """of a stage made from a capture; default: Y"""
    meters_per_unit: Annotated[float | None, option("METRES")] = None
    """how long a unit of the capture is; default: 1"""
    bake_axes: Annotated[bool, option()] = False
    """turn the splats themselves, harmonics included, instead of adding a transform"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRead:
    """What of a stage is read."""

    time: Annotated[float | None, option("FRAME")] = None
    """time code to read of a stage; default: its default values, or the first samples"""
    split: Annotated[bool, option()] = False
    """write each field to a file of its own, OUT with the prim's name before the suffix"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Captures:
    """How captures are read and written."""

    frame: Annotated[str | None, option("FRAME")] = None
    """to a stage: where x, y and z of the input point, default as the file says; to a capture:
    where those of the output are to point, default as is usual in its format"""
    lod: Annotated[int | None, option("LEVEL")] = None
    """level of a capture that has several to read, 0 the finest; default: 0"""
    spz_version: Annotated[int | None, option("3|4")] = None
    """of an .spz to write; default: 4"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat convert`."""

    source: Annotated[Positional[str], option("IN")]
    """capture or USD file to read"""
    others: Annotated[Positional[tuple[str, ...]], option("[IN ...] OUT")]
    """more to read into the same output, and the file to write; its suffix says what it becomes"""
    prim: Annotated[str | None, option("/PRIM")] = None
    """the field to write to or read from; default: one named as the file, or the whole stage"""
    json: Annotated[bool, option()] = False
    """print one JSON object about what was done"""
    stage_written: StageWritten = field(default_factory=StageWritten)
    stage_read: StageRead = field(default_factory=StageRead)
    captures: Captures = field(default_factory=Captures)
    edits: EditFlags = field(default_factory=EditFlags)


def arranged(words: Sequence[str]) -> list[str]:
    """What the user typed so that `Options` can be read of it: files and flags in any order."""
    switches = {"--help", "-h"}
    for group in (Options, StageWritten, StageRead, Captures):
        off = (item.name for item in fields(group) if item.default is False)
        switches |= {_flag(name) for name in off}
    return edit_flags.arranged(words, switches)


def run(options: Options) -> int:
    """Convert; print what became of it."""
    from usdsplat.formats import Reading, Writing
    from usdsplat.interchange import convert

    if not options.others:
        raise UsageError("convert", "no OUT", "one; see 'usdsplat convert --help'")
    sources, target = [Path(options.source), *map(Path, options.others[:-1])], options.others[-1]
    stage_written, stage_read, captures = (
        options.stage_written,
        options.stage_read,
        options.captures,
    )
    edits = edits_of(options.edits)
    _check_flags(options, sources, target)
    form: Form = "packed" if stage_written.packed else "half" if stage_written.half else "float"
    with console.progress() as progress:
        report = convert(
            sources,
            target,
            edits=edits,
            form=form,
            frame=captures.frame,
            up_axis=stage_written.up_axis,
            meters_per_unit=stage_written.meters_per_unit,
            prim_path=options.prim,
            bake_axes=stage_written.bake_axes,
            time=time_code(stage_read.time),
            split=stage_read.split,
            reading=Reading(lod=captures.lod or 0),
            writing=Writing(spz_version=captures.spz_version or 4),
            progress=progress,
        )
    if options.json:
        console.print_json(asdict(report))
    else:
        print(_told(report))
    return 0


def _check_flags(options: Options, sources: Sequence[Path], target: str) -> None:
    """Refuse a flag that would change nothing."""
    from usdsplat.formats.options import SPZ_VERSIONS
    from usdsplat.interchange.converting import check_target
    from usdsplat.interchange.files import is_usd

    becomes = is_usd(check_target(target))
    kinds = {(is_usd(source), becomes) for source in sources}
    meaningful = list(dict.fromkeys(name for kind in sorted(kinds) for name in _MEANINGFUL[kind]))
    for name in _given(options):
        if name not in meaningful:
            words = ["a stage" if kind else "a capture" for kind in (min(kinds)[0], becomes)]
            found = f"{words[0]} that becomes {words[1]}"
            raise UsageError(_flag(name), found, f"only {', '.join(map(_flag, meaningful))} then")
    lod, version = options.captures.lod, options.captures.spz_version
    if lod is not None and lod < 0:
        raise UsageError("--lod", str(lod), "a level, 0 the finest")
    if version is not None and not target.lower().endswith(".spz"):
        raise UsageError("--spz-version", target, "an .spz to write")
    if version not in (None, *SPZ_VERSIONS):
        raise UsageError("--spz-version", str(version), " or ".join(map(str, SPZ_VERSIONS)))


def _given(options: Options) -> list[str]:
    """Names of the flags with another value than their default."""
    groups: list[Any] = [options.stage_written, options.stage_read, options.captures]
    found = [
        item.name
        for group in groups
        for item in fields(group)
        if getattr(group, item.name) != item.default
    ]
    return found if options.prim is None else [*found, "prim"]


def _flag(name: str) -> str:
    """A field as it is typed."""
    return f"--{name.replace('_', '-')}"


def _told(report: Report) -> str:
    """The report for people, a few lines."""
    from usdsplat.interchange import ImportReport, RepackReport, SplitReport

    if isinstance(report, SplitReport):
        lines = [_told(part) for part in report.parts]
        return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
    if isinstance(report, RepackReport):
        found = counted(len(report.prim_paths), "field")
        samples, splats = counted(report.samples, "sample"), counted(report.splats, "splat")
        lines = [f"{report.target}: {found}, {samples}, {splats}, now {report.form}"]
        return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
    lines = [f"{report.target}: {counted(report.splats, 'splat')}, degree {report.degree}"]
    if isinstance(report, ImportReport):
        lines[0] += f", {report.form}, from {report.format}"
        lines.append(f"  prim   {report.prim_path}")
        lines.append(f"  axes   {report.axes}")
        lines += [f"  error  {name} {bound}" for name, bound in report.error_bounds.items()]
    else:
        lines += [f"  prim   {path}" for path in report.prim_paths]
        lines.append(f"  axes   {report.frame}")
    return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
