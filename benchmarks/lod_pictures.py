"""Draw a city of splats from near and from afar, with what each picture loaded:
`docs/huge_captures.jpg`.

    python -m benchmarks.lod_pictures [--splats N] [--folder DIR] [SHEET]

The city is that of `benchmarks.lod_scale`. Its tree is built in DIR, or used if it is there.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import lod_world
from benchmarks.lod_scale import looking
from usdsplat import build_tree
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.files import open_stage
from usdsplat.render.settings import RenderSettings

SIZE = (960, 540)
STRIP = 30
"""Height of the line of text below each picture [pixel]."""
SKY = (0.43, 0.52, 0.62)
"""Colour behind the city, in the display space."""
VIEWS = {"near": ((-30.0, 24.0, 104.0), 5.0, 1.0), "far": ((0.0, 1.3, 1.8), 34.0, 1.6)}
"""Name -> eye, angle below the horizon [degree], and focal length [height of the picture]. The near
eye is in metres; the far one is in edges of the city, from its middle."""


def drawn(tree: Path, name: str) -> Any:
    """Return a sheet with a picture of the tree, and a line about it."""
    from PIL import Image, ImageDraw, ImageFont

    place, tilt, focal = VIEWS[name]
    settings = RenderSettings(sorting="zDepth", color_mode="display")
    with Engine(open_stage(tree)) as engine:
        ((_, found),) = engine.render_scene.drawn_trees()
        low, high = found.box
        eye = np.array(place)
        if name == "far":
            eye = (high - low).max() * eye + (low + high) / 2 * (1, 0, 1)
        view = looking(eye.tolist(), tilt, focal, SIZE)
        picture = np.asarray(engine.picture(view, settings)["color"])
        table, loaded = found.spec.table, engine.render_scene.node_cache.bytes
        nodes = len({node for node, _ in found.fields})
        splats = sum(len(each.spec.cloud) for each in found.fields.values())
    color = picture[..., :3] + (1 - picture[..., 3:]) * SKY
    sheet = Image.new("RGB", (SIZE[0], SIZE[1] + STRIP), (24, 24, 24))
    sheet.paste(Image.fromarray((255 * np.clip(color, 0, 1) + 0.5).astype(np.uint8)))
    whole = found.spec.captured / 1e6
    line = (
        f"{name}: {splats / 1e6:.1f} of {whole:.0f} million splats, "
        f"{nodes} of {len(table)} nodes, {loaded / 2**20:.0f} MiB"
    )
    font = ImageFont.load_default(18)
    ImageDraw.Draw(sheet).text((12, SIZE[1] + 4), line, (225, 225, 225), font)
    return sheet


def main() -> None:
    """Build the tree, and write the sheet."""
    from PIL import Image

    parser = argparse.ArgumentParser(prog="lod_pictures")
    parser.add_argument("sheet", nargs="?", type=Path, default=Path("docs") / "huge_captures.jpg")
    parser.add_argument("--splats", type=float, default=10e6)
    parser.add_argument("--folder", type=Path, default=Path("lod_scale"))
    options = parser.parse_args()
    splats = int(options.splats)
    tree = options.folder / f"city_{splats // 1_000_000}M.usda"
    if not tree.exists():
        tiles = options.folder / "tiles"
        build_tree(
            lod_world.write_tiles(tiles, splats, processes=len(os.sched_getaffinity(0))), tree
        )
    sheets = [drawn(tree, name) for name in VIEWS]
    whole = Image.new("RGB", (SIZE[0], len(sheets) * sheets[0].height))
    for row, each in enumerate(sheets):
        whole.paste(each, (0, row * each.height))
    whole.save(options.sheet, quality=88)


if __name__ == "__main__":
    main()
