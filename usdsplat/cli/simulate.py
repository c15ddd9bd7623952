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
      two bakes side by side; with --chunk each is divided at checkpoints, see docs/farm.md
  usdsplat simulate --list-parameters
      every parameter with its range, unit and meaning

notes:
  bake.usda has the stage as a sublayer and can be opened in any USD application. Mute its data
  layer to see the capture again. A bake can be resumed from its last checkpoint, see
  bake:checkpointEvery, as long as its inputs have not changed. A finished bake keeps the state at
  the first frame of its last epoch (bake:clipFrames), bake_data/kept_checkpoint.
"""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.job_options import JobOptions, JobRunner, check_jobs, environments, of_task
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.cli.words import words_of
from usdsplat.core import interrupt
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.images.frame_numbers import LIMIT, parse_frames

if TYPE_CHECKING:
    from pxr import Usd

    from usdsplat.core.progress import Progress
    from usdsplat.sim.stage.simulating import Existing, SimulateOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat simulate`."""

    stage: Annotated[Path | None, positional("STAGE|CAPTURE")] = None
    """stage with a SplatSim prim; with --preset the capture to make a stage for"""
    output: Annotated[Path | None, option("FILE", short="-o")] = None
    """layer of results to write, a .usda; with --preset the stage to make"""
    frames: Annotated[str | None, option("A:B")] = None
    """frames such as 1:100; default: the stage's range"""
    preset: Annotated[str | None, option("grow|push|wade|conform|morph|dissolve|shatter")] = None
    """make a stage that is ready for simulation, and stop"""
    style: Annotated[str | None, option("NAME")] = None
    """with --preset grow: look of the new matter, such as moss; default: coral"""
    material: Annotated[str | None, option("NAME")] = None
    """with a preset that takes one: what the capture is made of"""
    target: Annotated[Path | None, option("STAGE|CAPTURE")] = None
    """with --preset conform or morph: meshes to move onto, by default a ring, or a capture to
    become"""
    overrides: Annotated[tuple[str, ...], option("[/PRIM.]NAME=VALUE", name="set")] = ()
    """value that overrides the stage's parameter, such as rd:preset=coral; may be repeated"""
    wedge: Annotated[
        tuple[str, ...], option("[/PRIM.]NAME=VALUE,VALUE ...", further=r"[^-=][^=]*:[^=]*=.*")
    ] = ()
    """bake every combination of these values, each in a layer beside the output that names them,
    and draw a contact sheet, the output with .png"""
    sheet_frame: Annotated[float | None, option("FRAME")] = None
    """with --wedge: frame of the contact sheet; default: the last one"""
    list_parameters: Annotated[bool, option()] = False
    """print every parameter and stop"""
    lod: Annotated[int | None, option("LEVEL", excludes="--max-splats")] = None
    """level of splat trees to simulate, 0 is the finest; not with --max-splats"""
    max_splats: Annotated[int | None, option("COUNT")] = None
    """simulate each splat tree with at most so many splats, by refining its largest errors first;
    default: as on the stage, else 1000000"""
    until: Annotated[float | None, option("FRAME")] = None
    """stop at the first checkpoint from this frame on; --resume goes on, with the same result"""
    resume: Annotated[bool, option()] = False
    """continue an interrupted bake, or add the further frames of --frames to a finished one"""
    force: Annotated[bool, option()] = False
    """replace an existing bake"""
    drop_checkpoint: Annotated[bool, option()] = False
    """do not keep the checkpoint from which frames can be added; with --resume also remove that of
    a finished bake"""
    axes: Annotated[str | None, option("AXES")] = None
    """directions of a capture's x, y and z, such as rdf; default: auto: as stated in the file, else
    as its splats suggest, else rdf"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that computes, auto, cpu or cuda; default: auto, which is the CPU"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    json: Annotated[bool, option()] = False
    """print one JSON object about the bake, or a JSON list of the parameters"""
    job: JobOptions = field(default_factory=JobOptions)
    stage_opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """List parameters, make a stage, or simulate one."""
    check_jobs(options.job, "--openjd")
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
    from usdsplat.cli.stages import open_stage
    from usdsplat.interchange.files import check_not_input, is_usd, layer_files
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.sim.stage.overrides import override

    if not is_usd(source):
        found = f"{source}, which is a capture"
        expected = "a stage with a SplatSim prim; --preset makes one"
        raise UsageError("simulate", found, expected)
    if not target.name:
        raise UsageError("--output", repr(str(target)), "a file")
    for name, given in _preset_options(options).items():
        if given is not None:
            raise UsageError(f"--{name}", f"{given!r} without --preset", "--preset with it")
    stage = open_stage(source, options.stage_opening, reporter)
    check_not_input(target, layer_files(stage))
    for text in (*_tree_overrides(options, stage), *options.overrides):
        override(stage, text)
    frames = _frames(options, stage)
    if options.until is not None and options.wedge:
        raise UsageError("--until", "--wedge too", "one of them")
    if options.sheet_frame is not None and not options.wedge:
        raise UsageError("--sheet-frame", f"{options.sheet_frame:g} without --wedge", "both")
    if options.job.is_asked:
        _run_tasks(options, stage, target, frames, reporter)
        options = replace(options, resume=True)
    announce = reporter.announce_compilation(
        "compiling kernels, once for each kind of simulation; it takes up to a minute"
    )
    with (
        compile_time() as compiled,
        reporter.progress(compiled) as progress,
        on_compile(announce),
        advising(reporter.arguments, None if options.wedge else target),
    ):
        order = _wedge if options.wedge else _simulate
        order(options, stage, target, frames, reporter, progress)
    return 0


def _run_tasks(
    options: Options,
    stage: Usd.Stage,
    target: Path,
    frames: tuple[float, ...],
    reporter: Reporter,
) -> None:
    """Bake by tasks; what is left, such as the contact sheet, is done with --resume."""
    from usdsplat.jobs.bakes import bake_job
    from usdsplat.products.wedge import WedgeOptions, parse_axes, planned

    if options.force:  # tasks may be repeated, and would begin anew what others have done
        raise UsageError("--force", "it with --jobs or --dask", "--resume, or a new name")
    made: dict[Path, tuple[str, ...]] = {target: ()}
    if options.wedge:
        how = WedgeOptions(simulate=simulate_options(options), frame=options.sheet_frame)
        wedge = planned(stage, target, frames, parse_axes(options.wedge), how)
        made = {each.target: each.settings for each in wedge}
    elif target.exists() and not options.resume:
        raise OutputError(str(target), "a file", "a new name, or --resume")
    device = "cpu" if options.device == "auto" else options.device
    task = replace(
        options, json=True, job=JobOptions(), reporting=of_task(options.reporting), wedge=(),
        sheet_frame=None, device=device, force=False, resume=False, until=None,
    )  # fmt: skip
    commands = {
        path.name: (
            "simulate",
            *words_of(replace(task, output=path, overrides=(*options.overrides, *settings))),
        )
        for path, settings in made.items()
    }
    workers = environments(options.job, device=device, threads=options.threads)
    job = bake_job(commands, frames, name="simulate", chunk=options.job.chunk, until=options.until)
    with JobRunner(options.job, reporter, workers[: len(made)]) as runner:
        for _ in runner.run(job):
            pass


def _simulate(
    options: Options,
    stage: Usd.Stage,
    target: Path,
    frames: tuple[float, ...],
    reporter: Reporter,
    progress: Progress,
) -> None:
    """Order one bake, and print its report."""
    from usdsplat.sim.stage.simulating import simulate

    report = simulate(
        stage, target, frames, simulate_options(options), progress=progress,
        findings=reporter.findings, rates=rates_file(),
    )  # fmt: skip
    if options.json:
        reporter.print_json(asdict(report))
        return
    if report.is_finished:
        console.say_path(target)
    if not options.job.is_asked:  # its tasks did the work
        reporter.remark(report.sentence())


def _wedge(
    options: Options,
    stage: Usd.Stage,
    target: Path,
    frames: tuple[float, ...],
    reporter: Reporter,
    progress: Progress,
) -> None:
    """Order the bakes of a wedge, and print their names."""
    from usdsplat.products.wedge import WedgeOptions, parse_axes, wedge

    how = WedgeOptions(simulate=simulate_options(options), frame=options.sheet_frame)
    report = wedge(
        stage, target, frames, parse_axes(options.wedge), how, progress=progress,
        findings=reporter.findings, rates=rates_file(),
    )  # fmt: skip
    if options.json:
        reporter.print_json(asdict(report))
        return
    for path in (*report.bakes, report.sheet):
        console.say_path(Path(path))


def simulate_options(options: Options) -> SimulateOptions:
    """Return the options of the simulation."""
    from usdsplat.sim.stage.simulating import SimulateOptions

    return SimulateOptions(
        device=options.device,
        threads=options.threads,
        existing=_existing(options),
        keeps_checkpoint=not options.drop_checkpoint,
        until=time_code(options.until),
    )


def rates_file() -> Path | None:
    """Return the file with the rates of this machine, beside the kernels that it compiled."""
    from usdsplat.kernels.store import folder

    kernels = folder()
    return None if kernels is None else kernels / "rates.json"


def resumed(arguments: Sequence[str]) -> str:
    """Return the command that continues another one."""
    words = [word for word in arguments if word not in ("--force", "--resume")]
    return shlex.join(["usdsplat", *words, "--resume"])


@contextmanager
def advising(arguments: Sequence[str], target: Path | None) -> Iterator[None]:
    """Tell how to go on if the context is interrupted.

    Args:
        arguments: The command line after the program's name.
        target: The bake; None for several.
    """
    interrupt.advise(f"go on with: {resumed(arguments)}")
    try:
        yield
        interrupt.advise("")
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


def _existing(options: Options) -> Existing:
    """Return how to treat an existing bake."""
    if options.resume:
        return "resume"
    return "replace" if options.force else "error"


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
    frames = parse_frames(options.frames)
    if any(later - earlier != 1 for earlier, later in itertools.pairwise(frames)):
        raise UsageError(
            "--frames", options.frames, "every frame from one to another, such as 1:100"
        )
    return frames
