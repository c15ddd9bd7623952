"""Histograms drawn by matplotlib, an optional dependency that is imported at the first page."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from usdsplat.core.errors import BackendError
from usdsplat.products.report.values import Histogram

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BAR, MEDIAN = "#466eaa", "#c85028"
INSTALL = "pip install 'usdsplat[plots]'"


def check_matplotlib() -> None:
    """Check that matplotlib is installed.

    Raises:
        BackendError: If it is not; the message has the command that installs it.
    """
    if not _can_import("matplotlib"):
        raise BackendError("--plot", "no matplotlib", INSTALL)


def _can_import(name: str) -> bool:
    """Return whether a module can be imported."""
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        return False
    return True


def draw_histogram(axes: Axes, histogram: Histogram, *, ink: str) -> None:
    """Draw a histogram with its title, its median and its summary.

    Args:
        axes: Empty axes.
        histogram: Has at least one bar.
        ink: Colour of axes and text.
    """
    from matplotlib.ticker import EngFormatter

    axes.stairs(histogram.counts, histogram.edges, fill=True, color=BAR)
    axes.axvline(histogram.median, color=MEDIAN)
    axes.set_facecolor("none")
    if histogram.logarithmic:
        _scale_logarithmically(axes, histogram)
    axes.yaxis.set_major_formatter(EngFormatter(sep=""))
    axes.set_xlim(histogram.edges[0], histogram.edges[-1])
    axes.set_title(histogram.title, loc="left", fontsize="medium", color=ink)
    axes.set_xlabel(histogram.summary(), loc="left", color=MEDIAN)
    axes.tick_params(axis="both", which="both", colors=ink)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["bottom", "left"]].set_color(ink)


def _scale_logarithmically(axes: Axes, histogram: Histogram) -> None:
    """Use a logarithmic axis with few labels, so that they do not overlap in a narrow chart."""
    from matplotlib.ticker import FixedLocator, LogLocator, StrMethodFormatter

    ends = histogram.edges[[0, -1]].tolist()
    ratio = ends[1] / ends[0]
    axes.set_xscale("log")
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:.3g}"))
    if ratio < 6:  # there may be no power of ten, nor three times one, in between
        axes.xaxis.set_major_locator(FixedLocator(ends))
    else:
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 3) if ratio < 1e3 else (1,), numticks=5))
