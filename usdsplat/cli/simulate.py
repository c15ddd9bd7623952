"""Simulate the splats of a stage, and bake the result into a layer.

examples:
  usdsplat simulate --preset grow scan.ply -o grow.usda
      make a stage with parameters to edit; presets: grow, push, wade, conform,
      morph, dissolve, shatter
  usdsplat simulate --preset morph scan.ply --target other.sog -o morph.usda
      a capture becomes another one; --preset conform --target mesh.usd moves it onto meshes
  usdsplat simulate grow.usda --frames 1:100 -o bake.usda
      run it; bake.usda shows the result, and the capture is not changed
  usdsplat simulate grow.usda -o bake.usda --set accretion:style=moss --set affector:friction=0.5
      with other values, without editing the stage
  usdsplat simulate city_grow.usda -o bake.usda --max-splats 300000
      simulate a cut of a splat tree; the bake is drawn in place of the tree
  usdsplat simulate grow.usda --frames 1:100 -o bake.usda --resume
      continue an interrupted bake, or make a finished one of fewer frames longer
  usdsplat simulate grow.usda -o bake.usda --wedge rd:feed=0.03,0.05 settle:omega=4,8
      bake each combination beside bake.usda, and compare them on a contact sheet, bake.png
  usdsplat simulate grow.usda -o bake.usda --wedge rd:feed=0.03,0.05 --jobs 2
      two bakes side by side; with --chunk each is divided at checkpoints; --openjd FOLDER writes a
      bundle for a farm, see docs/farm.md
  usdsplat simulate --list-parameters
      every parameter with its range, unit and meaning

notes:
  bake.usda has the stage as a sublayer and can be opened in any USD application. Mute its data
  layer to see the capture again. A bake can be resumed from its last checkpoint, see
  bake:checkpointEvery, as long as its inputs have not changed. A finished bake keeps the state at
  the first frame of its last epoch (bake:clipFrames), bake_data/kept_checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.cli import console
from usdsplat.cli.job_options import check_jobs, resumed
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.sharing import SharedPace, WorthSharing, capacity, may_share, shared
from usdsplat.cli.simulate_job import check_order, run_tasks, runner_of, write_bundle
from usdsplat.cli.simulate_options import BakeOrder, Options, consecutive
from usdsplat.core import interrupt
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import silent
from usdsplat.images.frame_numbers import LIMIT

if TYPE_CHECKING:
    from pxr import Usd

    from usdsplat.core.progress import Progress

FORKS = True
_BAKES = "bakes"
"""Label of the finished bakes of a wedge."""


def run(options: Options, reporter: Reporter) -> int:
    """List parameters, make a stage, or simulate one."""
    check_jobs(options.job)
    if options.list_parameters:
        from usdsplat.cli import parameter_table

        if options.json:
            console.print_json(parameter_table.rows())
        else:
            parameter_table.show()
        return 0
    if options.stage is None or options.output is None:
        missing = "no STAGE" if options.stage is None else "no --output"
        raise UsageError("simulate", missing, "a stage or capture, and -o FILE")
    if options.preset is not None:
        return _make(options, options.preset, reporter)
    return _bake(options, options.stage, options.output, reporter)


def _make(options: Options, preset: str, reporter: Reporter) -> int:
    """Write a stage from a preset."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.interchange.files import is_usd
    from usdsplat.products.presets import make_stage

    source, target = options.stage, options.output
    assert source is not None and target is not None  # checked by the caller
    for flag, given in (
        ("--frames", options.frames), ("--resume", options.resume), ("--set", options.overrides),
        ("--lod", options.lod is not None), ("--max-splats", options.max_splats is not None),
        ("--wedge", options.wedge), ("--jobs", options.job.is_asked),
    ):  # fmt: skip
        if given:
            raise UsageError(flag, f"--preset {preset} too", "one of them: first make, then run")
    if is_usd(source):
        open_stage(source, options.stage_opening, reporter)
        reporter.findings.check()
    with reporter.progress() as progress:
        files = make_stage(
            preset, source, target, axes=options.axes, progress=progress,
            options=_preset_options(options),
        )  # fmt: skip
    if options.json:
        reporter.print_json({"files": [str(path) for path in files]})
        return 0
    for path in files:
        console.say_path(path)
    reporter.remark(
        f"next: usdsplat simulate {target} -o {target.with_stem(target.stem + '_bake')}"
    )
    return 0


def _preset_options(options: Options) -> dict[str, str | None]:
    """Return the values of the flags of which a preset takes one."""
    target = None if options.target is None else str(options.target)
    return {"style": options.style, "material": options.material, "target": target}


def _bake(options: Options, source: Path, target: Path, reporter: Reporter) -> int:
    """Simulate a stage and write its bake."""
    from usdsplat.interchange.files import is_usd
    from usdsplat.kernels.compiling import compile_time, on_compile

    if not is_usd(source):
        found = f"{source}, which is a capture"
        expected = "a stage with a SplatSim prim; --preset makes one"
        raise UsageError("simulate", found, expected)
    if not target.name:
        raise UsageError("--output", repr(str(target)), "a file")
    for name, given in _preset_options(options).items():
        if given is not None:
            raise UsageError(f"--{name}", f"{given!r} without --preset", "--preset with it")
    _check_wedge(options)
    if options.job.is_asked:
        check_order(options, source, target)
        with runner_of(options, reporter) as runner:
            order = _ordered(options, source, target, reporter)
            if options.job.openjd is not None:
                return write_bundle(order, source, options.job.openjd, reporter)
            run_tasks(order, runner)
        order = replace(order, options=replace(options, resume=True))
    else:
        order = _ordered(options, source, target, reporter)
        if options.combination is not None:
            order = _combination(order, options.combination)
    announce = reporter.announce_compilation(
        "compiling kernels, once for each kind of simulation; it takes up to a minute"
    )
    try:
        with (
            compile_time() as compiled,
            reporter.progress(compiled) as progress,
            on_compile(announce),
            advising(reporter.arguments, None if order.options.wedge else order.target),
        ):
            if order.options.wedge:
                pace = _pace(order.options, reporter, compiled)
                _wedge(order, reporter, progress, pace)
            else:
                _simulate(order, reporter, progress)
    except WorthSharing as found:
        job = shared(options.job, found.processes, reporter)
        return _bake(replace(options, resume=True, job=job), source, target, reporter)
    return 0


def _pace(options: Options, reporter: Reporter, compiled: Callable[[], float]) -> Progress:
    """Return a receiver of the finished bakes of a wedge, which other processes may take over."""
    # those of a job go on with what is done, so they do not replace files
    if not may_share(options.job, reporter, options.threads, options.force or None):
        return silent
    here = partial(capacity, options.device)
    return SharedPace(_BAKES, silent, here, first=0, compiled=compiled)


def _ordered(options: Options, source: Path, target: Path, reporter: Reporter) -> BakeOrder:
    """Open the stage, and return what is to be baked."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.interchange.files import check_not_input, layer_files
    from usdsplat.sim.stage.overrides import override

    stage = open_stage(source, options.stage_opening, reporter)
    check_not_input(target, layer_files(stage))
    for text in (*_tree_overrides(options, stage), *options.overrides):
        override(stage, text)
    frames = _frames(options, stage)
    return BakeOrder(options=options, stage=stage, target=target, frames=frames)


def _check_wedge(options: Options) -> None:
    """Raise an error for a flag that has no effect with or without a wedge.

    Raises:
        UsageError: If there is one.
    """
    if options.wedge:
        if options.until is not None and options.combination is None:
            raise UsageError("--until", "--wedge too", "one of them, or --combination too")
        if options.combination is not None and options.job.is_asked:
            found = "it with --jobs, --dask or --openjd"
            raise UsageError("--combination", found, "one of them")
        return
    if options.sheet_frame is not None:
        raise UsageError("--sheet-frame", f"{options.sheet_frame:g} without --wedge", "both")
    if options.combination is not None:
        raise UsageError("--combination", f"{options.combination} without --wedge", "both")


def _combination(order: BakeOrder, number: int) -> BakeOrder:
    """Return the order of one bake of a wedge, whose values are given to the stage.

    Raises:
        UsageError: If there is no such bake.
    """
    from usdsplat.products.wedge import combinations, parse_axes
    from usdsplat.sim.stage.overrides import override

    made = combinations(parse_axes(order.options.wedge), order.target)
    if not 1 <= number <= len(made):
        raise UsageError("--combination", str(number), f"1 to {len(made)}")
    found = made[number - 1]
    for setting in found.settings:
        override(order.stage, setting, where="--wedge")
    return replace(order, target=found.target, options=replace(order.options, wedge=()))


def _simulate(order: BakeOrder, reporter: Reporter, progress: Progress) -> None:
    """Order one bake, and print its report."""
    from usdsplat.sim.stage.simulating import simulate

    report = simulate(
        order.stage, order.target, order.frames, order.simulate, progress=progress,
        findings=reporter.findings, rates=rates_file(),
    )  # fmt: skip
    if order.options.json:
        reporter.print_json(asdict(report))
        return
    if report.is_finished:
        console.say_path(order.target)
    if not order.options.job.is_asked:  # its tasks did the work
        reporter.remark(report.sentence())


def _wedge(order: BakeOrder, reporter: Reporter, progress: Progress, pace: Progress) -> None:
    """Order the bakes of a wedge, and print their names. `pace` receives each."""
    from usdsplat.products.wedge import parse_axes, wedge

    def baked(done: int, total: int) -> None:
        pace.step(_BAKES, done, total)

    report = wedge(
        order.stage, order.target, order.frames, parse_axes(order.options.wedge),
        replace(order.wedge, baked=baked), progress=progress, findings=reporter.findings,
        rates=rates_file(),
    )  # fmt: skip
    if order.options.json:
        reporter.print_json(asdict(report))
        return
    for path in (*report.bakes, report.sheet):
        console.say_path(Path(path))


def rates_file() -> Path | None:
    """Return the file with the rates of this machine, beside the kernels that it compiled."""
    from usdsplat.kernels.store import folder

    kernels = folder()
    return None if kernels is None else kernels / "rates.json"


@contextmanager
def advising(arguments: Sequence[str], target: Path | None) -> Iterator[None]:
    """Tell how to go on if the context is interrupted.

    Args:
        arguments: The command line after the program's name.
        target: The bake; None for several.
    """
    try:
        with interrupt.advising(f"go on with: {resumed(arguments)}"):
            yield
    except KeyboardInterrupt:
        from usdsplat.sim.stage.bake_layers import resume_frame

        if target is None:
            raise
        frame = resume_frame(target)
        after = "begin again" if frame is None else f"go on after frame {frame:g}"
        interrupt.advise(f"{after} with: {resumed(arguments)}")
        raise


def _tree_overrides(options: Options, stage: Usd.Stage) -> tuple[str, ...]:
    """Return the assignments of the flags that choose a cut of splat trees."""
    from usdsplat.schema import is_tree
    from usdsplat.sim.stage.collections import find_simulations, splats

    level, most = options.lod, options.max_splats
    if level is None and most is None:
        return ()
    if level is not None and level < 0:
        raise UsageError("--lod", str(level), "a level, 0 the finest")
    if most is not None and most < 1:
        raise UsageError("--max-splats", str(most), "at least 1")
    simulated = (prim for each in find_simulations(stage) for prim in splats(stage, each)[0])
    if not any(map(is_tree, simulated)):
        flag = "--max-splats" if level is None else "--lod"
        raise UsageError(flag, "a stage without a simulated splat tree", "one with a tree")
    if level is not None:
        return (f"sim:treeLevel={level}",)
    return ("sim:treeLevel=-1", f"sim:treeSplats={most}")


def _frames(options: Options, stage: Usd.Stage) -> tuple[float, ...]:
    """Return the frames to simulate, which must be consecutive and ascending."""
    if options.frames is None:
        if not stage.HasAuthoredTimeCodeRange():
            raise UsageError("--frames", "none, and a stage without a range", "such as 1:100")
        first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        if not 0 <= last - first < LIMIT:
            found = f"none, and a stage from {first:g} to {last:g}"
            raise UsageError("--frames", found, f"a range of at most {LIMIT} frames")
        return tuple(first + i for i in range(int(last - first) + 1))
    return consecutive(options.frames)
