"""Write a page as HTML. Pictures and charts are embedded, and nothing is loaded."""

from __future__ import annotations

import base64
import io
from html import escape
from pathlib import Path

from usdsplat.products.report.values import Histogram, Picture, Report

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 92rem; padding: 0 1rem;
       color: #1e2024; background: #fafaf8 }
.row { display: grid; gap: 1.5rem; grid-template-columns: repeat(auto-fit, minmax(18rem, 1fr)) }
figure { margin: 0 0 1.5rem } figcaption { color: #6b7078 }
.picture { position: relative } .picture img { width: 100%; display: block }
.bar { position: absolute; left: 3%; bottom: 3%; border: solid #fafaf8; border-width: 0 2px 2px;
       color: #fafaf8; box-sizing: border-box; padding-left: .3em }
svg { width: 100%; height: 11rem; display: block; border-bottom: 1px solid }
svg rect { fill: #466eaa } svg line { stroke: #c85028; vector-effect: non-scaling-stroke }
.ticks { position: relative; height: 1.6em; color: #6b7078 }
.ticks span { position: absolute; transform: translateX(-50%); font-size: .85em }
pre { overflow-x: auto; background: #f1f1ec; padding: 1rem }
@media (prefers-color-scheme: dark) { body { color: #e4e4e0; background: #17181b }
  figcaption, .ticks { color: #9aa0a8 } pre { background: #222429 } svg rect { fill: #7fa3dd } }
"""


def write(report: Report, path: Path) -> None:
    """Write the page in UTF-8."""
    title = escape(report.title)
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{_STYLE}</style><h1>{title}</h1>",
        f'<div class="row">{"".join(map(_picture, report.pictures))}</div>',
        f'<div class="row">{"".join(map(_chart, report.histograms))}</div>',
        f"<pre>{escape(chr(10).join(report.lines))}</pre></html>",
    ]
    path.write_text("\n".join(parts) + "\n", encoding="utf-8")


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
    """Return a histogram whose bars have tooltips with range and count."""
    most, width = int(histogram.counts.max()), 1 / len(histogram.counts)
    bars = "".join(
        f'<rect x="{i * width:.4f}" width="{0.85 * width:.4f}" y="{1 - count / most:.4f}" '
        f'height="{count / most:.4f}"><title>{histogram.edges[i]:.4g} to '
        f"{histogram.edges[i + 1]:.4g}: {count}</title></rect>"
        for i, count in enumerate(histogram.counts.tolist())
        if count
    )
    middle = min(max(histogram.place(histogram.median), 0.0), 1.0)
    ticks = "".join(
        f'<span style="left:{100 * place:.2f}%">{escape(text)}</span>'
        for place, text in histogram.ticks()
    )
    return (
        f"<figure><div>{escape(histogram.title)}</div>"
        f'<svg viewBox="0 0 1 1" preserveAspectRatio="none">{bars}'
        f'<line x1="{middle:.4f}" x2="{middle:.4f}" y1="0" y2="1"/></svg>'
        f'<div class="ticks">{ticks}</div>'
        f"<figcaption>{escape(histogram.summary())}</figcaption></figure>"
    )
