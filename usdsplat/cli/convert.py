"""Turn a capture into a stage, a stage into a capture, or either into another of its kind.

examples:
  usdsplat convert scan.ply scan.usdc
      a stage with one splat field, turned upright by a transform on the prim
  usdsplat convert scan.spz scan.usdc --up-axis Z --meters-per-unit 0.01 --frame rub
      for a Z-up pipeline; the capture is in centimetres and its y points up
  usdsplat convert scan.ply scan.usdc --packed
      a third of the size, in the compact type that needs usdsplat to be drawn
  usdsplat convert shot.usd still.ply --time 12 --prim /World/Tree
      what is beneath a prim at frame 12, in world space, as a capture
  usdsplat convert old.sog new.ply

notes:
  A frame is where x, y and z point: rdf is right, down, forward, as in most captures.
  The input is only read; the output appears when it is complete.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, create_mutex_group

from usdsplat.cli import console
from usdsplat.cli.parsing import option
from usdsplat.cli.values import time_code
from usdsplat.core.errors import UsageError
from usdsplat.core.wording import counted

if TYPE_CHECKING:
    from usdsplat.interchange.converting import Report
    from usdsplat.schema import Form

_NOT_FLAGS = ("source", "target", "json")
_MEANINGFUL = {
    (False, True): ("packed", "half", "up_axis", "frame", "meters_per_unit", "prim", "bake_axes"),
    (True, False): ("prim", "frame", "time"),
    (False, False): ("frame",),
    (True, True): ("packed", "half"),
}
"""Whether input and output are stages -> the flags that mean something."""
FORM = create_mutex_group(required=False, title="form")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat convert`."""

    source: Annotated[Positional[Path], option("IN")]
    """capture or USD file to read"""
    target: Annotated[Positional[str], option("OUT")]
    """file to write; its suffix says what it becomes"""
    packed: Annotated[bool, FORM, option()] = False
    """store fields in our compact type: 28 bytes a splat at degree 0, 76 at degree 3"""
    half: Annotated[bool, FORM, option()] = False
    """store fields as stock half floats, centres as floats: 124 bytes a splat at degree 3"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """of a stage made from a capture; default: Y"""
    frame: Annotated[str | None, option("FRAME")] = None
    """to a stage: where x, y and z of the input point, default as the file says; to a capture:
    where those of the output are to point, default rdf"""
    meters_per_unit: Annotated[float | None, option("METRES")] = None
    """how long a unit of the capture is; default: 1"""
    prim: Annotated[str | None, option("/PRIM")] = None
    """the field to write to or read from; default: one named as the file, or the whole stage"""
    bake_axes: Annotated[bool, option()] = False
    """turn the splats themselves, harmonics included, instead of adding a transform"""
    time: Annotated[float | None, option("FRAME")] = None
    """time code to read of a stage; default: its default values, or the first samples"""
    json: Annotated[bool, option()] = False
    """print one JSON object about what was done"""


def run(options: Options) -> int:
    """Convert; print what became of it."""
    from usdsplat.interchange import convert

    _check_flags(options)
    form: Form = "packed" if options.packed else "half" if options.half else "float"
    with console.progress() as progress:
        report = convert(
            options.source,
            options.target,
            form=form,
            frame=options.frame,
            up_axis=options.up_axis,
            meters_per_unit=options.meters_per_unit,
            prim_path=options.prim,
            bake_axes=options.bake_axes,
            time=time_code(options.time),
            progress=progress,
        )
    if options.json:
        console.print_json(asdict(report))
    else:
        print(_told(report))
    return 0


def _check_flags(options: Options) -> None:
    """Refuse a flag that would change nothing."""
    from usdsplat.interchange.converting import check_target
    from usdsplat.interchange.files import is_usd

    kinds = is_usd(options.source), is_usd(check_target(options.target))
    words = tuple("a stage" if kind else "a capture" for kind in kinds)
    meaningful = _MEANINGFUL[kinds]
    for item in fields(options):
        flag = f"--{item.name.replace('_', '-')}"
        if item.name in _NOT_FLAGS or getattr(options, item.name) == item.default:
            continue
        if item.name not in meaningful:
            known = ", ".join(f"--{name.replace('_', '-')}" for name in meaningful)
            found = f"{words[0]} that becomes {words[1]}"
            raise UsageError(flag, found, f"only {known} with that")


def _told(report: Report) -> str:
    """The report for people, a few lines."""
    from usdsplat.interchange import ImportReport, RepackReport

    if isinstance(report, RepackReport):
        fields = counted(len(report.prim_paths), "field")
        samples, splats = counted(report.samples, "sample"), counted(report.splats, "splat")
        lines = [f"{report.target}: {fields}, {samples}, {splats}, now {report.form}"]
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
