"""Measure where captures arrive: conform onto meshes, and morph, by the presets as they are.

    python -m benchmarks.conform [NAME ...] [--pictures FOLDER]

For the last frame, in six views: intersection over union of the silhouettes (opacity above one half
against the target's), and mean opacity inside and outside of the target's silhouette. For the map
of the carriers: variation of the distance to the six nearest images, and the part of the eight
nearest neighbours at rest whose images are within three and within six spacings. With `--pictures`,
a strip of five frames of each is written.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import DATA, scene_of, view_of
from usdsplat.core import edit
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.progress import silent
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.products.presets import make_stage
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View
from usdsplat.sim.specs import Surface
from usdsplat.sim.stage import spaces
from usdsplat.sim.stage.simulating import Simulation

VIEWS = ((0, 0), (60, 0), (120, 0), (35, 30), (155, -20), (275, 45))
"""Azimuth and elevation [deg]."""
SIZE = 512
"""Width and height of pictures [pixel]."""
FIELD = 30.0
"""Field of view [deg]."""
STRIP = (1, 28, 40, 52, 80)
"""Frames of a strip; the last is measured."""
BACKGROUND = np.float32((0.09, 0.1, 0.12))
MAN = DATA / "usd" / "usdwg" / "CesiumMan.usdz"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """A capture and what it becomes."""

    capture: str
    target: str
    """A capture, "man" or "sphere"."""

    @property
    def is_morph(self) -> bool:
        """Whether the target is a capture."""
        return "." in self.target


PAIRS = {
    "pod": Pair(capture="pod.spz", target="man"),
    "playbot": Pair(capture="playbot_lod2.sog", target="sphere"),
    "statue": Pair(capture="statue_angel.sog", target="statue_massa.sog"),
    "guitar": Pair(capture="guitar.compressed.ply", target="man"),
    "flowers": Pair(capture="flowers_lod2_0.sog", target="man"),
}


def target_file(name: str, folder: Path) -> Path:
    """Return the file of a target."""
    if name == "man":
        return MAN
    if name != "sphere":
        return DATA / "splats" / name
    file = folder / "sphere.usda"
    stage = Usd.Stage.CreateNew(str(file))
    stage.SetDefaultPrim(UsdGeom.Sphere.Define(stage, "/Sphere").GetPrim())
    stage.Save()
    return file


def camera(low: F64, high: F64, azimuth: float, elevation: float) -> tuple[View, F64, F64]:
    """Return a view of a box, its OpenCV matrix and its intrinsics."""
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    distance = 0.95 * radius / np.sin(np.radians(FIELD / 2))
    a, e = np.radians((azimuth, elevation))
    away = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    side = np.cross(-away, (0, 1, 0))
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = side, -np.cross(side, -away), -away
    matrix[:3, 3] = -matrix[:3, :3] @ (middle + distance * away)
    focal = SIZE / 2 / np.tan(np.radians(FIELD / 2))
    k = np.array([[focal, 0, SIZE / 2], [0, focal, SIZE / 2], [0, 0, 1]])
    return view_of(matrix, k, (SIZE, SIZE)), matrix, k


def silhouette(surface: Surface, matrix: F64, k: F64) -> F32:
    """Return the coverage of a mesh, shape (h, w), from a picture of four times the size."""
    from PIL import Image, ImageDraw

    scale = 4
    points = surface.points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    pixels = points @ k.T
    pixels = scale * pixels[:, :2] / pixels[:, 2:]
    image = Image.new("L", (scale * SIZE, scale * SIZE))
    draw = ImageDraw.Draw(image)
    for corners in pixels[surface.triangles]:
        draw.polygon([tuple(each) for each in corners.tolist()], fill=255)
    whole = np.asarray(image, np.float32).reshape(SIZE, scale, SIZE, scale) / 255
    return whole.mean(axis=(1, 3))


class Shot:
    """A simulated preset, with its splats and its target in the world."""

    def __init__(self, pair: Pair, folder: Path) -> None:
        made = folder / "shot.usda"
        preset = "morph" if pair.is_morph else "conform"
        goal = target_file(pair.target, folder)
        make_stage(
            preset,
            DATA / "splats" / pair.capture,
            made,
            axes=None,
            progress=silent,
            options={"target": str(goal)},
        )
        self.stage = Usd.Stage.Open(str(made))
        self.device = open_device("cpu")
        frames = [float(number) for number in range(1, STRIP[-1] + 1)]
        self.spent: dict[str, float] = {}
        self._last = time.perf_counter()
        self.simulation = Simulation(self.stage, frames, device=self.device, lap=self._lap)
        self.simulation.begin()
        (self.path,) = self.simulation.recipes
        self.frame = 1

    def go_to(self, frame: int) -> None:
        """Simulate up to a frame."""
        while self.frame < frame:
            self.simulation.advance()
            self.frame += 1

    def cloud(self) -> SplatCloud:
        """Return the splats in the world."""
        cloud = replace(self.simulation.frame(self.path).cloud, velocities=None)
        return edit.transform(cloud, self._to_world())

    def target(self) -> Surface | SplatCloud:
        """Return the target in the world."""
        moment = self.simulation.recipes[self.path].at(self.frame)
        if moment.becomes is not None:
            return edit.transform(moment.becomes, self._to_world())
        assert moment.target is not None
        points = spaces.transform_points(moment.to_world, moment.target.points)
        return replace(moment.target, points=points)

    def carriers(self) -> tuple[F32, F32]:
        """Return the places of carriers at rest, and their images."""
        kept = self.simulation.checkpoint()[self.path].globals
        return kept["conform:map:positions"], kept["conform:map:images"]

    def _to_world(self) -> F64:
        prim = self.stage.GetPrimAtPath(self.path)
        return spaces.to_world(prim, Usd.TimeCode(self.frame))

    def _lap(self, name: str) -> None:
        now = time.perf_counter()
        self.spent[name] = self.spent.get(name, 0.0) + now - self._last
        self._last = now


def measured(shot: Shot, renderer: Renderer) -> dict[str, float]:
    """Return the measures of a shot at its last frame."""
    cloud, target = shot.cloud(), shot.target()
    points = (target.points if isinstance(target, Surface) else target.positions).astype(float)
    margin = 0 if isinstance(target, Surface) else 1
    low, high = np.percentile(points, (margin, 100 - margin), axis=0)
    rows = []
    for azimuth, elevation in VIEWS:
        view, matrix, k = camera(low, high, azimuth, elevation)
        alpha = picture(renderer, cloud, view)[..., 3]
        if isinstance(target, Surface):
            wanted = silhouette(target, matrix, k)
        else:
            wanted = picture(renderer, target, view)[..., 3]
        is_in, drawn = wanted > 0.5, alpha > 0.5
        rows.append(
            (
                (is_in & drawn).sum() / (is_in | drawn).sum(),
                alpha[wanted > 0.999].mean(),
                alpha[wanted < 0.001].mean(),
            )
        )
    union, inside, outside = np.array(rows).T
    rest, images = shot.carriers()
    device = shot.device
    around = nearest(device, images, images, 7)[1][:, 1:].mean(axis=1)
    spacing = float(np.median(around))
    near = nearest(device, rest, rest, 9)[0][:, 1:]
    apart = np.linalg.norm(images[near] - images[:, None], axis=2) / spacing
    frame = shot.simulation.frame(shot.path).cloud
    visible = frame.opacities > 0
    local = around[nearest(device, images, frame.positions, 1)[0][:, 0]]
    return {
        "carriers": len(images),
        "union": float(union.min()),
        "inside": float(inside.min()),
        "outside": float(outside.max()),
        "variation": float(around.std() / around.mean()),
        "largest": float((frame.scales.max(axis=1) / local)[visible].max()),
        "within_3": float((apart < 3).mean()),
        "within_6": float((apart < 6).mean()),
    }


def picture(renderer: Renderer, cloud: SplatCloud, view: View) -> F32:
    """Return a picture, shape (h, w, 4), premultiplied."""
    bands = renderer.render(scene_of(cloud), view, RenderSettings(), ("color",))
    return np.concatenate([band.arrays["color"].copy() for band in bands])


def strip(shot: Shot, renderer: Renderer) -> tuple[F32, bool]:
    """Simulate a shot. Return the frames of STRIP side by side, and whether the first one is the
    capture bit for bit."""
    first = shot.simulation.frame(shot.path).cloud
    rest = shot.simulation.recipes[shot.path].rest
    names = ("positions", "rotations", "scales", "opacities", "sh")
    is_rest = all(np.array_equal(getattr(first, name), getattr(rest, name)) for name in names)
    places = shot.cloud().positions.astype(np.float64)
    low, high = np.percentile(places, (1, 99), axis=0)
    half = 0.65 * float((high - low).max())
    middle, row = (low + high) / 2, []
    view = camera(middle - half, middle + half, 35, 12)[0]
    for frame in STRIP:
        shot.go_to(frame)
        image = picture(renderer, shot.cloud(), view)
        row.append(image[..., :3] + (1 - image[..., 3:]) * BACKGROUND)
    return np.concatenate(row, axis=1), is_rest


def main(arguments: list[str]) -> None:
    """Print the table."""
    with Report("conform", arguments) as report:
        folder: Path | None = None
        names = list(report.arguments)
        if "--pictures" in names:
            at = names.index("--pictures")
            folder = Path(names[at + 1])
            del names[at : at + 2]
        table = Table(title="Captures that became something else")
        heads = (
            "capture", "target", "carriers", "seconds", "IoU", "inside", "outside", "spacing CV",
            "largest", "in 3", "in 6", "starts as captured",
        )  # fmt: skip
        for head in heads:
            table.add_column(head)
        renderer = Renderer(open_device("cpu"))
        for name in names or PAIRS:
            pair = PAIRS[name]
            with tempfile.TemporaryDirectory() as made:
                shot = Shot(pair, Path(made))
                image, is_rest = strip(shot, renderer)
                values = measured(shot, renderer)
            seconds = shot.spent.get("beginning", 0.0) + shot.spent.get("joining", 0.0)
            report.add(scene=name, splats=len(shot.cloud()), seconds=seconds, **values)
            table.add_row(
                pair.capture, pair.target, f"{values['carriers']:,}", f"{seconds:.1f}",
                f"{values['union']:.3f}", f"{values['inside']:.3f}", f"{values['outside']:.4f}",
                f"{values['variation']:.3f}", f"{values['largest']:.2f}",
                f"{values['within_3']:.1%}", f"{values['within_6']:.1%}",
                "yes" if is_rest else "no",
            )  # fmt: skip
            if folder is not None:
                _save(image, folder / f"conform_{name}.png")
        report.show(table)


def _save(image: F32, path: Path) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.uint8(np.clip(image, 0, 1) * 255 + 0.5)).save(path)


if __name__ == "__main__":
    main(sys.argv[1:])
