"""Write a page as HTML. Pictures and charts are embedded, and nothing is loaded."""

from __future__ import annotations

import base64
import io
from html import escape

from usdsplat.products.report.plots import draw_histogram
from usdsplat.products.report.values import Histogram, Picture, Report

_INK = "#808488"
"""Colour of a chart's text, readable on light and on dark pages."""
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 92rem; padding: 0 1rem;
       color: #1e2024; background: #fafaf8 }
.row { display: grid; gap: 1.5rem; grid-template-columns: repeat(auto-fit, minmax(18rem, 1fr)) }
figure { margin: 0 0 1.5rem } figcaption { color: #6b7078 }
.picture { position: relative } .picture img { width: 100%; display: block }
.bar { position: absolute; left: 3%; bottom: 3%; border: solid #fafaf8; border-width: 0 2px 2px;
       color: #fafaf8; box-sizing: border-box; padding-left: .3em }
.chart { width: 100% }
pre { overflow-x: auto; background: #f1f1ec; padding: 1rem }
@media (prefers-color-scheme: dark) { body { color: #e4e4e0; background: #17181b }
  figcaption { color: #9aa0a8 } pre { background: #222429 } }
"""


def encode(report: Report) -> bytes:
    """Return the page in UTF-8."""
    title = escape(report.title)
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{_STYLE}</style><h1>{title}</h1>",
        f'<div class="row">{"".join(map(_picture, report.pictures))}</div>',
        f'<div class="row">{"".join(map(_chart, report.histograms))}</div>',
        f"<pre>{escape(chr(10).join(report.lines))}</pre></html>",
    ]
    return ("\n".join(parts) + "\n").encode(errors="backslashreplace")


def _picture(picture: Picture) -> str:
    """Return a picture with a scale bar."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture.pixels).save(data, "PNG")
    image = base64.b64encode(data.getvalue()).decode()
    title, text = escape(picture.title), escape(picture.bar_text)
    return (
        f'<figure><div class="picture"><img alt="{title}" src="data:image/png;base64,{image}">'
        f'<div class="bar" style="width:{100 * picture.bar:.2f}%">{text}</div></div>'
        f"<figcaption>{title}</figcaption></figure>"
    )


def _chart(histogram: Histogram) -> str:
    """Return a histogram as an image; it is an SVG that fits light and dark pages."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.4, 2.6), layout="constrained")
    figure.patch.set_visible(False)
    axes = figure.add_subplot(facecolor="none")
    draw_histogram(axes, histogram, ink=_INK)
    data = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(data, format="svg")
    image = base64.b64encode(data.getvalue()).decode()
    title = escape(f"{histogram.title}: {histogram.summary()}")
    source = f"data:image/svg+xml;base64,{image}"
    return f'<figure><img class="chart" alt="{title}" src="{source}"></figure>'
