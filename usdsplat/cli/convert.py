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

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, create_mutex_group

from usdsplat.cli import console
from usdsplat.cli.parsing import option

if TYPE_CHECKING:
    from usdsplat.interchange.converting import Report
    from usdsplat.schema import Form

FORM = create_mutex_group(required=False, title="form")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat convert`."""

    source: Annotated[Positional[Path], option("IN")]
    """capture or USD file to read"""
    target: Annotated[Positional[Path], option("OUT")]
    """file to write; its suffix says what it becomes"""
    packed: Annotated[bool, FORM, option()] = False
    """store fields in our compact type: 28 bytes a splat at degree 0, 76 at degree 3"""
    half: Annotated[bool, FORM, option()] = False
    """store fields as stock half floats, centres as floats: 124 bytes a splat at degree 3"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """of a stage made from a capture; default: Y"""
    frame: Annotated[str | None, option("FRAME")] = None
    """where x, y and z of the capture point; default: as the file says, rdf for a new one"""
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
            time=options.time,
            progress=progress,
        )
    if options.json:
        console.print_json(asdict(report))
    else:
        print(_told(report))
    return 0


def _told(report: Report) -> str:
    """The report for people, a few lines."""
    from usdsplat.interchange import ImportReport, RepackReport

    if isinstance(report, RepackReport):
        fields = f"{len(report.prim_paths)} fields, {report.samples} samples"
        return f"{report.target}: {fields}, {report.splats} splats, now {report.form}"
    lines = [f"{report.target}: {report.splats} splats, degree {report.degree}"]
    if isinstance(report, ImportReport):
        lines[0] += f", {report.form}, from {report.format}"
        lines.append(f"  prim   {report.prim_path}")
        lines.append(f"  axes   {report.axes}")
        lines += [f"  error  {name} {bound}" for name, bound in report.error_bounds.items()]
    else:
        lines += [f"  prim   {path}" for path in report.prim_paths]
        lines.append(f"  axes   {report.frame}")
    return "\n".join([*lines, *(f"  note   {note}" for note in report.notes)])
