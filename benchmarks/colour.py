"""Measure colour accuracy: a chart of 24 splat patches in every colour mode.

    python -m benchmarks.colour

Each picture is converted to what an sRGB display shows, and compared with the capture, or with the
requested grade, by CIE 2000. Views are applied by OpenImageIO. Expected grades are computed by
colour-science alone.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from tests import chart
from usdsplat import schema
from usdsplat.core.cloud import F64
from usdsplat.images.science import colour_science
from usdsplat.images.view import open_view

ACES2 = {
    "ocio_config": "ocio://studio-config-latest",
    "ocio_view": "ACES 2.0 - SDR 100 nits (Rec.709)",
}
ACES1 = {
    "ocio_config": "ocio://studio-config-v2.2.0_aces-v1.3_ocio-v2.4",
    "ocio_view": "ACES 1.0 - SDR Video",
}
MODES: dict[str, dict[str, Any]] = {
    "display": {"color_mode": "display"},
    "scene, Rec.709": {"color_mode": "scene"},
    "scene, ACEScg": {"color_mode": "scene", "working_space": "lin_ap1_scene"},
    "inverseView, ACES 1.3, ACEScg": {
        "color_mode": "inverseView", "working_space": "lin_ap1_scene", **ACES1,
    },
    "inverseView, ACES 2.0, ACEScg": {
        "color_mode": "inverseView", "working_space": "lin_ap1_scene", **ACES2,
    },
    "inverseView, ACES 2.0, Rec.709": {"color_mode": "inverseView", **ACES2},
}  # fmt: skip


def main(report: Report) -> None:
    """Print the table."""
    table = Table("mode", "mean ΔE2000", "max ΔE2000", "fails", title="24 patches of a chart")
    for name, settings in MODES.items():
        found = chart.patches(chart.picture(chart.chart_stage(), **settings))
        shown, failed = as_shown(found, settings)
        _row(table, name, shown, captured(), failed)
    stage = chart.chart_stage()
    prim = stage.GetPrimAtPath(chart.FIELD)
    schema.author_grade(prim, exposure=-0.5, temperature=3200.0, saturation=0.8)
    found = chart.patches(chart.picture(stage, color_mode="scene", blend_space="linear"))
    _row(table, "graded, scene, Rec.709", found, graded(), "")
    report.show(table)
    report.say(f"1920x1080 back through ACES 2.0, checked by going forth: {_seconds():.2f} s")


def captured() -> F64:
    """Return the colours of the chart as stored in an sRGB capture, linear Rec.709."""
    rgb: F64 = colour_science().models.eotf_sRGB(chart.chart_codes())
    return rgb


def graded() -> F64:
    """Return the chart with the grade that `main` applies, linear Rec.709."""
    colour = colour_science()
    space = colour.RGB_COLOURSPACES["sRGB"]
    tungsten = colour.UCS_uv_to_xy(colour.temperature.CCT_to_uv_Krystek1985(3200.0))
    daylight = colour.temperature.CCT_to_xy_CIE_D(6504.0)
    xyz = colour.chromatic_adaptation(
        captured() @ space.matrix_RGB_to_XYZ.T,
        colour.xy_to_XYZ(tungsten),
        colour.xy_to_XYZ(daylight),
        transform="Bradford",
    )
    rgb = xyz @ space.matrix_XYZ_to_RGB.T * 2**-0.5
    luminance = (rgb @ space.matrix_RGB_to_XYZ[1])[:, None]
    result: F64 = luminance + 0.8 * (rgb - luminance)
    return result


def as_shown(found: F64, settings: dict[str, Any]) -> tuple[F64, str]:
    """Return what an sRGB display shows of a picture, linear Rec.709, and the failed fraction."""
    colour = colour_science()
    mode, space = settings["color_mode"], settings.get("working_space", "lin_rec709_scene")
    if mode == "display":
        return colour.models.eotf_sRGB(found), ""
    if mode == "scene":
        own = {"lin_rec709_scene": "sRGB", "lin_ap1_scene": "ACEScg"}[space]
        return colour.RGB_to_RGB(found, own, "sRGB", "Bradford"), ""
    view = open_view(
        config=settings["ocio_config"], view=settings["ocio_view"], working_space=space
    )
    codes = view.forward(found[None].astype(np.float32))[0]
    _, failed = view.inverse(chart.chart_codes()[None].astype(np.float32), most=65504.0)
    return colour.models.eotf_sRGB(codes.astype(np.float64)), f"{failed.mean():.1%}"


def _row(table: Table, name: str, found: F64, wanted: F64, failed: str) -> None:
    difference = chart.delta_e(np.maximum(found, 0.0), np.maximum(wanted, 0.0))
    table.add_row(name, f"{difference.mean():.4f}", f"{difference.max():.4f}", failed)


def _seconds() -> float:
    """Return the median of three timings."""
    view = open_view(
        config=ACES2["ocio_config"], view=ACES2["ocio_view"], working_space="lin_ap1_scene"
    )
    codes = np.random.default_rng(0).random((1080, 1920, 3)).astype(np.float32)
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        view.inverse(codes, most=65504.0)
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


if __name__ == "__main__":
    with Report("colour", sys.argv[1:]) as report:
        main(report)
