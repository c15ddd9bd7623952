"""Define the options of `usdsplat simulate`."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli.arguments import option, positional
from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core.errors import UsageError
from usdsplat.images.frame_numbers import parse_frames

if TYPE_CHECKING:
    from pxr import Usd

    from usdsplat.products.wedge import WedgeOptions
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
    combination: Annotated[int | None, option("N")] = None
    """with --wedge: bake only this combination, from 1, as a task of its own; the values of the
    last parameter change first"""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class BakeOrder:
    """What is to be baked: a stage, which has the values of the flags, and where to."""

    options: Options
    stage: Usd.Stage
    target: Path
    frames: tuple[float, ...]
    """Consecutive time codes."""

    @property
    def simulate(self) -> SimulateOptions:
        """The options of each bake."""
        from usdsplat.sim.stage.simulating import SimulateOptions

        options = self.options
        return SimulateOptions(
            device=options.device,
            threads=options.threads,
            existing=self._existing,
            keeps_checkpoint=not options.drop_checkpoint,
            until=time_code(options.until),
        )

    @property
    def wedge(self) -> WedgeOptions:
        """The options of a wedge."""
        from usdsplat.products.wedge import WedgeOptions

        return WedgeOptions(simulate=self.simulate, frame=self.options.sheet_frame)

    @property
    def _existing(self) -> Existing:
        if self.options.resume:
            return "resume"
        return "replace" if self.options.force else "error"


def consecutive(text: str) -> tuple[float, ...]:
    """Return the frames of --frames, which must follow each other without a gap.

    Raises:
        UsageError: If they are others.
    """
    frames = parse_frames(text)
    if any(later - earlier != 1 for earlier, later in itertools.pairwise(frames)):
        raise UsageError("--frames", text, "every frame from one to another, such as 1:100")
    return frames
