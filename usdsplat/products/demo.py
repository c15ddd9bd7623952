"""Make a capture, a stage, pictures and sequences: the main job from end to end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from usdsplat import formats
from usdsplat.core import axes, edit
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.progress import Progress
from usdsplat.core.sh import coefficient_count
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import import_capture
from usdsplat.interchange.files import open_stage
from usdsplat.interchange.procedural import capture as procedural_capture
from usdsplat.kernels import ahead, signatures
from usdsplat.kernels.device import checked_threads
from usdsplat.products.drawing import draw_frames
from usdsplat.products.movie import save_animation
from usdsplat.products.planning import plan_pictures
from usdsplat.products.request import RenderRequest
from usdsplat.products.turntable import author_turntable
from usdsplat.schema.usd_files import export_layer
from usdsplat.sim.stage.overrides import override
from usdsplat.sim.stage.presets import author_preset
from usdsplat.sim.stage.simulating import SimulateOptions, simulate

COARSE, GROWN = 50_000, 300_000
"""Number of splats of the model for the simulation, and maximum number of a capture for it."""
KERNELS = Path(__file__).with_name("demo_kernels.txt")
"""Every kernel that the demo runs, with argument types, in the order of first use."""
QUICKER = ("sim:substeps=2", "rd:substeps=40")
"""Parameter values below the preset's. The demo then simulates in seconds, and the pattern still
visibly spreads."""
RATE = 24.0
"""Frame rate of the animations [frame/s]."""

Tell = Callable[[Path, str], None]
"""Callback that receives each complete file with a description."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoRequest:
    """Inputs and output folder of the demo."""

    capture: Path | None
    """Capture to use; None for a generated one."""
    folder: Path
    """Output folder, created if it is missing."""
    splats: int
    """Approximate number of splats of the generated capture."""
    frames: int
    """Length of each sequence."""
    threads: int | None
    """Number of threads; None for all cores."""


def make_demo(request: DemoRequest, *, progress: Progress, tell: Tell) -> Path:
    """Run the whole demo and return its stage.

    Args:
        request: Inputs and output folder.
        progress: Receives the progress of each part.
        tell: Receives each file.

    Raises:
        UsageError: If a number is out of range.
        OutputError: If a file cannot be written.
        FormatError: If the capture is damaged or of another format.
    """
    if not (1 <= request.frames <= 10_000 and 1_000 <= request.splats <= 20_000_000):
        found = f"{request.splats} splats, {request.frames} frames"
        raise UsageError("demo", found, "1000 to 20000000 splats and 1 to 10000 frames")
    checked_threads(request.threads)
    return _Demo(request, _made(request.folder), progress, tell).run()


class _Demo:
    """One run of the demo."""

    def __init__(self, request: DemoRequest, folder: Path, progress: Progress, tell: Tell) -> None:
        self._request = request
        self._folder = folder
        self._progress = progress
        self._tell = tell
        self._frames = tuple(float(frame) for frame in range(1, request.frames + 1))

    def run(self) -> Path:
        """Produce all files and return the stage."""
        folder = self._folder
        kernels = signatures.read(KERNELS)
        with ahead.compiling(kernels, jobs=self._request.threads):
            capture = self._request.capture or self._model(folder / "capture.ply")
            report = import_capture(capture, folder / "capture.usdc", progress=self._progress)
            self._tell(folder / "capture.usdc", f"{report.splats} splats as a prim, from {capture}")
            stage = folder / "stage.usda"
            author_turntable(stage, folder / "capture.usdc", frames=self._request.frames)
            self._tell(stage, "the stage with camera, animation and render settings")
            self._render(stage)
            if self._request.capture is None:
                self._grow(self._model_coarsely())
            elif report.splats <= GROWN:
                self._grow(stage)
            else:
                why = f"no simulation: {report.splats} splats are too many for the demo"
                self._tell(folder, why)
        return stage

    def _model(self, path: Path, *, splats: int | None = None, degree: int = 3) -> Path:
        """Generate a capture and write it with axes rdf, which is usual for captures."""
        self._progress.step("modelling a still life", 0, 1)
        cloud = procedural_capture(splats or self._request.splats)
        cloud = replace(cloud, sh=cloud.sh[:, : coefficient_count(degree)])
        self._progress.step("modelling a still life", 1, 1)
        turn = np.eye(4)
        turn[:3, :3] = axes.change("rub", "rdf")
        formats.write(edit.transform(cloud, turn), path, progress=self._progress)
        self._tell(path, "a generated still life, as a capture file")
        return path

    def _model_coarsely(self) -> Path:
        """Generate the capture again with fewer splats, and write a stage for it."""
        stage, imported = (self._folder / f"coarse{suffix}" for suffix in (".usda", ".usdc"))
        splats = min(self._request.splats, COARSE)
        capture = self._model(self._folder / "coarse.ply", splats=splats, degree=0)
        import_capture(capture, imported, progress=self._progress)
        author_turntable(stage, imported, frames=self._request.frames)
        self._tell(stage, "the same stage with fewer splats, for the simulation")
        return stage

    def _grow(self, source: Path) -> None:
        """Simulate matter that grows on the stage's splats, then bake and draw it."""
        growth, bake = source.with_name("growth.usda"), source.with_name("growth_bake.usda")
        author_preset("grow", open_stage(source), growth, last=self._request.frames)
        stage = open_stage(growth)
        for text in QUICKER:
            override(stage, text, layer=stage.GetRootLayer())
        export_layer(stage.GetRootLayer(), growth)
        self._tell(growth, "a simulation: new matter grows on the capture")
        running = SimulateOptions(threads=self._request.threads, existing="replace")
        report = simulate(stage, bake, self._frames, running, progress=self._progress)
        count = sum(report.splats.values())
        self._tell(bake, f"the result as opinions over the capture: {count} splats at the end")
        with Engine(open_stage(bake), threads=self._request.threads) as engine:
            pictures = self._draw(engine, bake, "sequence", "growth.####.png", self._frames)
        self._tell(
            self._folder / "growth.####.png", f"{self._request.frames} frames of the simulation"
        )
        self._animate(pictures, "growth.webp", "the simulation as an animated picture")

    def _render(self, stage: Path) -> None:
        """Draw the products of the stage, and an animation of the sequence."""
        around = f"{self._request.frames} frames around the capture"
        with Engine(open_stage(stage), threads=self._request.threads) as engine:
            for product, name, frames, text in (
                ("still", "still.png", self._frames[:1], "as a viewer shows it"),
                (
                    "layers",
                    "still.exr",
                    self._frames[:1],
                    "linear colour, depth and ids, for compositing",
                ),
                ("sequence", "sequence.####.png", self._frames, around),
            ):
                pictures = self._draw(engine, stage, product, name, frames)
                self._tell(self._folder / name, text)
        self._animate(pictures, "sequence.webp", "the sequence as an animated picture")

    def _draw(
        self, engine: Engine, stage: Path, product: str, name: str, frames: tuple[float, ...]
    ) -> list[Path]:
        """Draw a product of a stage and return its files."""
        output = str(self._folder / name)
        plans = plan_pictures(engine, RenderRequest(product=f"/Render/{product}", output=output))
        drawn = draw_frames(engine, plans, frames, source=str(stage), progress=self._progress)
        return [picture.path for picture in drawn]

    def _animate(self, pictures: list[Path], name: str, text: str) -> None:
        """Write pictures as an animation."""
        self._tell(save_animation(pictures, self._folder / name, rate=RATE), text)


def _made(folder: Path) -> Path:
    """Create the folder if it is missing, and return it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise OutputError(str(folder), found, "a folder that can be made") from error
    return folder
