"""Measure what shadows cost: the first picture, and pictures of a camera that moves.

    python -m benchmarks.lighting [--device cpu|cuda] [--json FILE]

The garden casts shadows on itself, with authored normals, and also on a ground of two triangles, as
a picture of 1920x1080. A hard light has one sample, a soft one 16, a sky 128. "First" is a new
renderer; its kernels are compiled. "Moved" is the median of five pictures from other places, under
a sky that of one. Times are those of the processor on the CPU, and wall times on a GPU [ms].
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import afresh, garden, view_of
from usdsplat.kernels.devices import open_device
from usdsplat.render.lights.dome import plain_sky
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import FieldSpec, InstanceSpec, MeshSpec, SurfaceSpec

SIZE = (1920, 1080)
MOVES = 5


SUN = LightSpec(direction=(0.48, 0.8, 0.36), irradiance=(1.0, 1.0, 1.0))
LIGHTS = {
    "hard": SUN,
    "soft": replace(SUN, angle=0.02),
    "sky": LightSpec(
        kind="dome", sky=plain_sky(), radiance=(1.0, 1.0, 1.0), to_world=tuple(np.eye(4).ravel())
    ),
}


def lit_scene(light: LightSpec, *, ground: bool) -> tuple[RenderScene, Any]:
    """Return the garden under a light, and its view."""
    cloud, matrix, k = garden()
    normals = np.tile(np.float32([0, -1, 0]), (len(cloud), 1))
    lit = FieldSpec(cloud=cloud, surface=SurfaceSpec(normals=normals))
    scene = RenderScene()
    scene.set_field("/field", lit)
    scene.set_instances("/field", (InstanceSpec(path="/field"),))
    if ground:
        low, high = scene.subject() or (np.zeros(3), np.ones(3))
        corners = [(low[0], low[2]), (high[0], low[2]), (high[0], high[2]), (low[0], high[2])]
        points = np.float32([(x, high[1], z) for x, z in corners])
        triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
        mesh = MeshSpec(points=points, triangles=triangles, faces=np.zeros(2, np.int32))
        scene.set_mesh("/ground", mesh)
        scene.set_instances("/ground", (InstanceSpec(path="/ground"),))
    scene.set_light("/light", light)
    return scene, view_of(matrix, k, SIZE)


def main() -> None:
    """Print the table."""
    name = sys.argv[sys.argv.index("--device") + 1] if "--device" in sys.argv else "cpu"
    clock: Callable[[], float] = time.process_time if name == "cpu" else time.perf_counter
    with Report("lighting", [each for each in sys.argv[1:] if each not in ("--device", name)]) as r:
        table = Table(title="time of a picture [ms]")
        for column in ("scene", "light", "captured", "first", "moved", "first / captured"):
            table.add_column(column, justify="right")
        for ground in (False, True):
            for label, light in LIGHTS.items():
                scene, view = lit_scene(light, ground=ground)
                moves = MOVES if light.kind == "distant" else 1
                device = open_device(name)

                def drawn(renderer: Renderer, number: int, scene=scene, view=view, **options):
                    settings = RenderSettings(
                        sorting="zDepth", color_mode="display", self_shadows=True, **options
                    )
                    start = clock()
                    for _ in renderer.render(scene, afresh(view, number), settings, ("color",)):
                        pass
                    return 1000 * (clock() - start)

                warm = Renderer(device)
                drawn(warm, 0, lighting="shadowed", light_samples=1, dome_samples=1)
                plain = float(np.median([drawn(warm, 1 + k) for k in range(MOVES)]))
                renderer = Renderer(device)
                first = drawn(renderer, 20, lighting="shadowed")
                moved = [drawn(renderer, 30 + k, lighting="shadowed") for k in range(moves)]
                what = "garden and ground" if ground else "garden"
                later = float(np.median(moved))
                table.add_row(
                    what, label, f"{plain:.0f}", f"{first:.0f}", f"{later:.0f}",
                    f"{first / plain:.1f}",
                )  # fmt: skip
                r.add(
                    device=name, scene=f"{what}, {label}", ms=first, later_ms=later, captured=plain
                )
        r.show(table, 100)


if __name__ == "__main__":
    main()
