"""Make a capture, a stage, pictures and sequences, to see it all work.

examples:
  usdsplat demo
      a still life of our own, into ./demo
  usdsplat demo scan.ply -o /tmp/demo
      the same with a capture of yours
  usdsplat demo --splats 1000000 --frames 100

notes:
  The stages it leaves open in usdview and in every other application of USD 26.3 or later.
  A pattern grows on a capture of up to 300,000 splats, or on a coarser model of our own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from usdsplat.cli import console
from usdsplat.cli.parsing import option
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.progress import Progress

COARSE, GROWN = 50_000, 300_000
"""How many splats are modelled to be simulated, and most that a capture may have for it."""
BALL = "/World/Simulation/Ball"
COMPILING = "compiling kernels, once for this machine; it takes a minute or two"
KERNELS = Path(__file__).parents[1] / "products" / "demo_kernels.txt"
"""Every kernel that the demo runs, with argument types, in the order of first use."""
QUICKER = ("sim:substeps=2", "rd:substeps=40")
"""Parameters below the preset's: the demo then simulates in seconds, and the pattern is still seen
to spread."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat demo`."""

    capture: Annotated[Positional[Path | None], option("[CAPTURE]")] = None
    """capture to use; default: one that is modelled for the occasion"""
    output: Annotated[Path, option("DIR", short="-o")] = Path("demo")
    """folder to fill, made if it is missing; default: demo"""
    splats: Annotated[int, option("N")] = 200_000
    """how detailed our own capture is; default: about 200000"""
    frames: Annotated[int, option("N")] = 24
    """length of each sequence; default: 24"""
    threads: Annotated[int | None, option("N")] = None
    """how many to use; default: all"""
    json: Annotated[bool, option()] = False
    """print one JSON list of the files and what each is"""


@dataclass(slots=True, kw_only=True)
class Results:
    """What was made, told to people as it is finished, or to programs in the end."""

    is_json: bool
    told: list[dict[str, str]] = field(default_factory=list)

    def tell(self, path: Path, text: str) -> None:
        """One result."""
        self.told.append({"path": str(path), "text": text})
        if not self.is_json:
            print(f"{path!s:<28} {text}", flush=True)

    def finish(self, advice: str) -> None:
        """That was all."""
        if self.is_json:
            console.print_json(self.told)
        else:
            print(advice)


def run(options: Options) -> int:
    """Run the main job from end to end; print each result with what it is."""
    from usdsplat.interchange import import_capture
    from usdsplat.kernels import ahead, signatures
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.kernels.device import checked_threads
    from usdsplat.products.turntable import author_turntable

    if not (1 <= options.frames <= 10_000 and 1_000 <= options.splats <= 20_000_000):
        found = f"{options.splats} splats, {options.frames} frames"
        raise UsageError("demo", found, "1000 to 20000000 splats and 1 to 10000 frames")
    checked_threads(options.threads)
    folder = _made(options.output)
    results = Results(is_json=options.json)
    with (
        compile_time() as compiled,
        console.progress(compiled) as progress,
        on_compile(console.announce_compilation(COMPILING)),
        ahead.compiling(signatures.read(KERNELS), jobs=options.threads),
    ):
        own = folder / "capture.ply"
        capture = options.capture or _model(own, options.splats, results, progress)
        report = import_capture(capture, folder / "capture.usdc", progress=progress)
        results.tell(folder / "capture.usdc", f"{report.splats} splats as a prim, from {capture}")
        author_turntable(folder / "stage.usda", folder / "capture.usdc", frames=options.frames)
        results.tell(folder / "stage.usda", "the stage: camera, animation, render settings")
        _render(folder, options, results, progress)
        stage: Path | None = folder / "stage.usda"
        if options.capture is None:
            stage = _model_coarsely(folder, options, results, progress)
        elif report.splats > GROWN:
            results.tell(folder, f"nothing grown on it: {report.splats} splats are many for a demo")
            stage = None
        if stage is not None:
            _grow(stage, options, results, progress)
    results.finish(f"next: usdsplat info {folder / 'stage.usda'}")
    return 0


def _made(folder: Path) -> Path:
    """The folder, there for sure."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise OutputError(str(folder), found, "a folder that can be made") from error
    return folder


def _model(
    path: Path, splats: int, results: Results, progress: Progress, *, degree: int = 3
) -> Path:
    """Model our own capture and write it as captures are: frame rdf."""
    from dataclasses import replace

    import numpy as np

    from usdsplat import formats
    from usdsplat.core import axes, edit
    from usdsplat.core.sh import coefficient_count
    from usdsplat.interchange.procedural import capture

    progress.step("modelling a still life", 0, 1)
    cloud = capture(splats)
    cloud = replace(cloud, sh=cloud.sh[:, : coefficient_count(degree)])
    progress.step("modelling a still life", 1, 1)
    turn = np.eye(4)
    turn[:3, :3] = axes.change("rub", "rdf")
    formats.write(edit.transform(cloud, turn), path, progress=progress)
    results.tell(path, "a still life of our own, as a capture file")
    return path


def _model_coarsely(folder: Path, options: Options, results: Results, progress: Progress) -> Path:
    """Our own capture again, with fewer splats, and a stage of it."""
    from usdsplat.interchange import import_capture
    from usdsplat.products.turntable import author_turntable

    splats = min(options.splats, COARSE)
    capture = _model(folder / "coarse.ply", splats, results, progress, degree=0)
    import_capture(capture, folder / "coarse.usdc", progress=progress)
    author_turntable(folder / "coarse.usda", folder / "coarse.usdc", frames=options.frames)
    results.tell(folder / "coarse.usda", "the stage again, coarser, for something to grow on it")
    return folder / "coarse.usda"


def _grow(source: Path, options: Options, results: Results, progress: Progress) -> None:
    """Let a pattern grow on the stage's splats while a ball passes, bake and draw it."""
    from usdsplat.interchange.files import open_stage
    from usdsplat.products.turntable import look_across
    from usdsplat.sim.stage.overrides import override
    from usdsplat.sim.stage.presets import author_preset
    from usdsplat.sim.stage.simulating import simulate

    growth, bake = source.with_name("growth.usda"), source.with_name("growth_bake.usda")
    author_preset("grow", open_stage(source), growth, last=options.frames)
    stage = open_stage(growth)
    look_across(stage, BALL)
    for text in QUICKER:
        override(stage, text, layer=stage.GetRootLayer())
    stage.GetRootLayer().Save()
    results.tell(growth, "a simulation: a pattern grows on the capture, and a ball passes")
    frames = tuple(float(frame) for frame in range(1, options.frames + 1))
    report = simulate(stage, bake, frames, threads=options.threads, force=True, progress=progress)
    count = sum(report.splats.values())
    results.tell(bake, f"its result, opinions over the capture: {count} splats at the end")
    _draw_growth(bake, frames, options, results, progress)


def _draw_growth(
    bake: Path, frames: tuple[float, ...], options: Options, results: Results, progress: Progress
) -> None:
    """Draw a bake, the ball too, and make a preview of it."""
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.files import open_stage
    from usdsplat.products.drawing import draw_frames
    from usdsplat.products.planning import Request, plan

    output = bake.with_name("growth.####.png")
    with Engine(open_stage(bake), threads=options.threads) as engine:
        pictures = plan(engine, Request(product="/Render/sequence", output=str(output)))
        drawn = list(draw_frames(engine, pictures, frames, source=str(bake), progress=progress))
    results.tell(output, f"{options.frames} frames of it")
    _animate([picture.path for picture in drawn], bake.with_name("growth.webp"))
    results.tell(bake.with_name("growth.webp"), "the same as one moving picture")


def _render(folder: Path, options: Options, results: Results, progress: Progress) -> None:
    """Draw the products of the stage, and make a preview of the sequence."""
    from usdsplat.delegate.engine import Engine
    from usdsplat.interchange.files import open_stage
    from usdsplat.products.drawing import draw_frames
    from usdsplat.products.planning import Request, plan

    stage = open_stage(folder / "stage.usda")
    numbers = tuple(float(frame) for frame in range(1, options.frames + 1))
    with Engine(stage, threads=options.threads) as engine:
        for product, name, frames, text in (
            ("still", "still.png", numbers[:1], "as a viewer shows it"),
            ("layers", "still.exr", numbers[:1], "linear colour, depth and ids, for compositing"),
            ("sequence", "sequence.####.png", numbers, f"{options.frames} frames around it"),
        ):
            request = Request(product=f"/Render/{product}", output=str(folder / name))
            pictures = plan(engine, request)
            source = str(folder / "stage.usda")
            drawn = list(draw_frames(engine, pictures, frames, source=source, progress=progress))
            results.tell(folder / name, text)
    _animate([picture.path for picture in drawn], folder / "sequence.webp")
    results.tell(folder / "sequence.webp", "the sequence as one moving picture")


def _animate(pictures: Sequence[Path], target: Path) -> None:
    """Put pictures after each other, 24 a second, over and over."""
    from PIL import Image

    from usdsplat.core.output import atomic_path

    first, *others = [Image.open(path) for path in pictures]
    with atomic_path(target) as path:
        first.save(path, save_all=True, append_images=others, duration=1000 / 24, loop=0)
