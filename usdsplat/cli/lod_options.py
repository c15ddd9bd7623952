"""Define the options of `usdsplat lod`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat.cli.arguments import option, positional
from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import ReportingOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat lod`."""

    sources: Annotated[tuple[Path, ...], positional("[IN ...] IN")]
    """captures and stages to read, any number"""
    output: Annotated[Path | None, option("OUT", short="-o")] = None
    """USD file to write, .usd, .usda or .usdc; missing folders are made"""
    memory_limit: Annotated[str | None, option("SIZE")] = None
    """memory to use, such as 800M or 6G; what does not fit is on disk beside OUT until the end;
    default: 4G"""
    pixel: Annotated[float | None, option("SIZE")] = None
    """size of a pixel of the photographs at the splats, in units of the first input: merged splats
    get the low-pass of classic pictures at this size, at most that of all inputs; 0 for none;
    default: as authored, else that of a picture of 540 lines that frames an input"""
    leaf_splats: Annotated[int | None, option("N")] = None
    """largest number of splats of a node, 256 to 65536; default: 16384"""
    sh_degree: Annotated[int | None, option("DEGREE")] = None
    """highest degree of the harmonics, 0 to 4; default: that of the inputs"""
    axes: Annotated[str | None, option("AXES")] = None
    """directions of x, y and z of all captures, such as rdf; default: auto: as stated in each file,
    else as their splats suggest, else rdf"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """up axis of OUT; default: that of the first input if it is a stage, else Y"""
    meters_per_unit: Annotated[float | None, option("METRES")] = None
    """length of one unit of all captures, and of OUT, in metres; default: as stated by their
    formats, else 1"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code at which stages are read; default: their default values, or the first samples"""
    step: Annotated[str | None, option("begin|sort|build")] = None
    """do only this step of the building, for a farm: begin first, then sort and build in parts,
    then the command without a step, which does what is left"""
    part: Annotated[str | None, option("K/N")] = None
    """part K, from 1, of N parts of --step sort or build, which may be done side by side"""
    json: Annotated[bool, option()] = False
    """print one JSON object with a report"""
    job: JobOptions = field(default_factory=JobOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)
