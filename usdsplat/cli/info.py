"""Describe a capture or a stage.

examples:
  usdsplat info scan.ply
      number of splats, size, format, axes and accuracy
  usdsplat info shot.usd
      every splat field with statistics, every splat tree with its levels, and cameras, frames and
      render products
  usdsplat info shot.usd --frame 12
  usdsplat info city.usda --camera /World/Cam --lod-error 2 --resolution 960x540
      what a picture of the camera loads of splat trees: nodes, splats, and bytes in memory
  usdsplat info scan.sog --json
  usdsplat info tiles/lod-meta.json
      a streamed SOG: levels of detail with splats and errors, and files
  usdsplat info scan.sog --plot report.html
      the same with pictures from three sides and histograms; .png works too;
      needs matplotlib, the extra [plots]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from usdsplat.cli import console
from usdsplat.cli.arguments import flags_of, given, option, positional
from usdsplat.cli.flag_names import spelled
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import resolution_of, time_code
from usdsplat.core.errors import UsageError
from usdsplat.core.text import shown
from usdsplat.render.settings import RenderSettings

if TYPE_CHECKING:
    from usdsplat.products.report import Report


LevelFlags: Any = flags_of(RenderSettings, ("lod_error", "splat_budget"))


@dataclass(frozen=True, kw_only=True)
class ViewOptions(LevelFlags):
    """The view of which it is described what it loads of splat trees."""

    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name; default: every camera, or one that frames everything; animated cameras are at
    --frame, or at the first frame"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """size of the picture in pixels; default: that of the product with the camera, or else of the
    first product, or 1920x1080"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat info`."""

    file: Annotated[Path, positional("FILE")]
    """capture or stage to describe"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code at which a stage is read; default: default values, or the first samples"""
    json: Annotated[bool, option()] = False
    """print one JSON object"""
    plot: Annotated[Path | None, option("FILE")] = None
    """also write a page with histograms and views from front, right and above: .png or .html"""
    view: ViewOptions = field(default_factory=ViewOptions)
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Print a description of the file."""
    from usdsplat.cli.stages import check_no_stage_options
    from usdsplat.interchange.files import is_usd

    if options.plot:
        from usdsplat.products.report import check_target

        check_target(options.plot, options.file)
    if is_usd(options.file):
        described = _stage(options, reporter)
    else:
        check_no_stage_options(options.file, options.opening)
        view = options.view
        flags = {"frame": options.frame, "camera": view.camera, "resolution": view.resolution}
        flags |= given(view)
        for name in (name for name, value in flags.items() if value is not None):
            raise UsageError(f"--{spelled(name)}", f"a capture, {options.file}", "a stage")
        described = _capture(options, reporter)
    if options.json:
        reporter.print_json(described)
    else:
        console.say("\n".join(_lines(described, "")))
    return 0


def _stage(options: Options, reporter: Reporter) -> dict[str, Any]:
    """Describe a stage, and draw it if asked."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.products import summary
    from usdsplat.products.checking import opening_findings
    from usdsplat.products.tree_views import ViewRequest

    view = ViewRequest(
        camera=options.view.camera,
        resolution=resolution_of(options.view.resolution),
        settings=given(options.view),
    )
    time = time_code(options.frame)
    with reporter.progress() as progress:
        stage = open_stage(options.file, options.opening, reporter)
        reporter.findings.extend(opening_findings(stage, time))
        described = summary.of_stage(
            stage, time, view=view, findings=reporter.findings, progress=progress
        )
    described = {"file": str(options.file), **described}
    if options.plot:
        from usdsplat.products import report

        reporter.findings.check()
        make = partial(report.of_stage, stage, time)
        _draw(options, described, make, reporter)
    return described


def _capture(options: Options, reporter: Reporter) -> dict[str, Any]:
    """Describe a capture, and draw it if asked."""
    from usdsplat import formats
    from usdsplat.interchange.streamed import is_streamed
    from usdsplat.products import summary

    if is_streamed(options.file):
        return _streamed(options, reporter)
    with reporter.progress() as progress:
        capture = formats.read(options.file, progress=progress)
    described = {"file": str(options.file), **summary.of_capture(capture)}
    if options.plot:
        from usdsplat.products import report

        _draw(options, described, partial(report.of_capture, capture), reporter)
    return described


def _streamed(options: Options, reporter: Reporter) -> dict[str, Any]:
    """Describe a streamed SOG without reading its finest level, and draw it if asked."""
    from usdsplat.products import tree_summary

    with reporter.progress() as progress:
        found, stage = tree_summary.of_streamed(options.file, progress=progress)
    described = {"file": str(options.file), **found}
    if options.plot:
        from usdsplat.products import report

        _draw(options, described, partial(report.of_stage, stage, None), reporter)
    return described


def _draw(
    options: Options,
    described: dict[str, Any],
    make: Callable[[str, list[str]], Report],
    reporter: Reporter,
) -> None:
    """Write the page that `make` returns for a title and the printed text."""
    from usdsplat.kernels.compiling import on_compile
    from usdsplat.products import report

    assert options.plot is not None  # checked by the callers
    with on_compile(reporter.announce_compilation()):
        page = make(shown(options.file.name), _lines(described, ""))
    report.write(page, options.plot)


def _lines(value: dict[str, Any], indent: str) -> list[str]:
    """Return a description as indented lines, without empty values."""
    lines = []
    for key, item in value.items():
        name = key.replace("_", " ")
        if item is None or item is False or item in ([], {}, ""):
            continue
        if key == "agrees":
            continue  # the remark says it if they do not
        if isinstance(item, list) and isinstance(item[0], dict):
            for entry in item:
                if all(isinstance(part, int | float) for part in entry.values()):
                    lines.append(f"{indent}{name:<18} {_text(entry)}")
                else:
                    lines += [f"{indent}{name}", *_lines(entry, indent + "  ")]
        elif isinstance(item, list) and isinstance(item[0], str):
            lines += [f"{indent}{name:<18} {shown(entry)}" for entry in item]
        elif isinstance(item, dict) and any(isinstance(v, str) for v in item.values()):
            lines += [f"{indent}{name}", *_lines(item, indent + "  ")]
        else:
            lines.append(f"{indent}{name:<18} {_text(item)}")
    return lines


def _text(item: Any) -> str:
    """Return one value as text."""
    if isinstance(item, dict):
        return "  ".join(f"{key} {_text(entry)}" for key, entry in item.items())
    if isinstance(item, list):
        return " ".join(f"({_text(e)})" if isinstance(e, list) else _text(e) for e in item)
    if isinstance(item, bool):
        return "yes"
    return f"{item:.6g}" if isinstance(item, float) else shown(item)
