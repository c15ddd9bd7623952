"""Make a page about a capture or a stage: pictures from three sides, histograms, and the text of
`info`.

The page is a value, `Report`, with two writers: PNG, and HTML that needs no other file.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pxr import Usd

from usdsplat import schema
from usdsplat.core.axes import UP_AXIS_FRAME
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError, UsdSplatError
from usdsplat.core.output import write_output
from usdsplat.formats import Capture
from usdsplat.interchange.authoring import author_field, prepare
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.placement import placement
from usdsplat.products.report import html_page, png_page
from usdsplat.products.report.charts import Numbers
from usdsplat.products.report.plots import check_matplotlib
from usdsplat.products.report.values import Report
from usdsplat.products.report.views import views
from usdsplat.schema.lod_roots import find_roots
from usdsplat.schema.stage_values import up_axis
from usdsplat.schema.validation import splat_fields

__all__ = ["Report", "check_target", "of_capture", "of_stage", "write"]

_PRIM = "Capture"
"""Root prim of the field on the stage of a report."""
_ENCODERS = {".png": png_page.encode, ".html": html_page.encode}


def check_target(path: Path, source: Path) -> None:
    """Raise an error, before any work is done, for a page that cannot be written.

    Raises:
        UsageError: If the suffix is neither .png nor .html, or it is the file that is described.
        BackendError: If matplotlib is not installed.
    """
    if path.suffix.lower() not in _ENCODERS:
        raise UsageError("--plot", f"suffix {path.suffix!r}", f"one of {', '.join(_ENCODERS)}")
    if path.exists() and source.exists() and path.samefile(source):
        raise UsageError("--plot", f"{path}, which is being described", "another file")
    check_matplotlib()


def of_capture(capture: Capture, title: str, lines: Iterable[str]) -> Report:
    """Return the page of a capture.

    Args:
        capture: The capture; it is not changed.
        title: Heading of the page.
        lines: Text of `info`.
    """
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, None, None)
    capture = with_axes(capture, choose_axes(capture))
    placed = placement(stage, capture.frame, None)
    where = stage.GetPseudoRoot().GetPath().AppendChild(_PRIM)
    author_field(stage, where, capture, placed, form="float", bake_axes=False)
    return _report([capture.cloud], stage, None, capture.frame, title, lines)


def of_stage(stage: Usd.Stage, time: float | None, title: str, lines: Iterable[str]) -> Report:
    """Return the page of a stage at a time, without fields that cannot be read.

    Args:
        stage: The stage; it is not changed.
        time: Time code; None for default values, or the first samples.
        title: Heading of the page.
        lines: Text of `info`.
    """
    clouds, roots = [], find_roots(stage)
    for prim in splat_fields(stage):
        if roots.is_replaced(prim):
            continue
        try:
            clouds.append(schema.fetch(prim, time))
        except UsdSplatError:
            continue  # the text of `info` has the reason
    frame = UP_AXIS_FRAME[up_axis(stage)]
    return _report(clouds, stage, time, frame, title, lines)


def write(report: Report, path: Path) -> None:
    """Write the page. An existing file is replaced when the new one is complete.

    Raises:
        OutputError: If the file cannot be written.
    """
    write_output(path, _ENCODERS[path.suffix.lower()](report))


def _report(
    clouds: Iterable[SplatCloud],
    stage: Usd.Stage,
    time: float | None,
    frame: str,
    title: str,
    lines: Iterable[str],
) -> Report:
    return Report(
        title=title,
        pictures=views(stage, time, frame),
        histograms=Numbers.of(clouds).histograms(),
        lines=tuple(lines),
    )
