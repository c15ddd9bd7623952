"""Define the options of `convert`, and check that those given fit the kind of conversion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from usdsplat.cli.arguments import flags_of, option, positional
from usdsplat.cli.edit_flags import EditFlags
from usdsplat.cli.job_options import JobOptions
from usdsplat.cli.reporting import ReportingOptions
from usdsplat.core.errors import UsageError
from usdsplat.render.settings import RenderSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class StageWritten:
    """How to write a stage."""

    packed: Annotated[bool, option(excludes="--half")] = False
    """store fields in the packed type: 28 bytes per splat at degree 0, 76 at degree 3; not with
    --half"""
    half: Annotated[bool, option()] = False
    """store fields in USD's type as half floats, centres as floats: 124 bytes per splat at degree
    3"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """up axis of a stage made from a capture; default: Y"""
    meters_per_unit: Annotated[float | None, option("METRES")] = None
    """length of one unit of the capture in metres; default: as stated by its format, else 1"""
    bake_axes: Annotated[bool, option()] = False
    """rotate the splats themselves, harmonics included, instead of adding a transform"""
    cameras: Annotated[Path | None, option("PATH")] = None
    """add cameras beside the field from the poses of the photographs: a COLMAP folder, or the
    transforms.json of instant-ngp or nerfstudio"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRead:
    """What to read from a stage."""

    frame: Annotated[float | None, option("FRAME")] = None
    """time code at which a stage is read; default: its default values, or the first samples"""
    split: Annotated[bool, option()] = False
    """write one file per field, named OUT with the prim's name before the suffix"""
    max_splats: Annotated[int | None, option("COUNT")] = None
    """read each splat tree with at most so many splats, by refining its largest errors first"""
    flatten: Annotated[bool, option()] = False
    """from stage to stage: write one self-contained file with the selected variants; default: keep
    variants, references and payloads, and write the converted fields over them"""


LevelFlags: Any = flags_of(RenderSettings, ("lod_error", "splat_budget", "background"))


@dataclass(frozen=True, kw_only=True)
class ViewOptions(LevelFlags):
    """The nodes of splat trees that a picture of a camera draws, instead of a level."""

    camera: Annotated[str | None, option("CAMERA")] = None
    """path or name of the camera, also for each frame of a sequence; out of its view, trees are as
    coarse as possible; --frame is then the first one of the stage by default; of a page, the camera
    that it begins with, by default the one of render"""
    resolution: Annotated[str | None, option("WIDTHxHEIGHT")] = None
    """size of the picture in pixels; default: that of the product with the camera, or else of the
    first product, or 1920x1080"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """For sequences: IN or OUT with a placeholder for the frame number, such as cap.####.ply."""

    frames: Annotated[str | None, option("RANGE")] = None
    """frames such as 7, 1-10, 1:10x2 or 1,5,8-12; of a page, those of its camera; default: all"""
    clips: Annotated[bool, option()] = False
    """write value clips instead of time samples: one file per frame in a folder beside OUT"""
    rate: Annotated[float | None, option("FPS")] = None
    """frames per second of a sequence that becomes a stage; default: 24"""
    interpolate: Annotated[bool, option()] = False
    """treat row i of all frames as the same splat, and interpolate it between frames"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Captures:
    """How to read and write captures."""

    axes: Annotated[str | None, option("AXES")] = None
    """directions of x, y and z, such as rdf; to a stage: those of the input, default auto: as
    stated in the file, else as its splats suggest, else rdf; to a capture: those of the output,
    default as usual for its format"""
    lod: Annotated[int | None, option("LEVEL", excludes="--max-splats")] = None
    """level to read from a capture or a splat tree with levels of detail, 0 is the finest; default:
    0; not with --max-splats"""
    spz_version: Annotated[int | None, option("3|4")] = None
    """version of an .spz to write; default: 4"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat convert`."""

    source: Annotated[str, positional("IN")]
    """capture or USD file to read"""
    others: Annotated[tuple[str, ...], positional("[IN ...] OUT")]
    """further inputs for the same output, and the file to write; its suffix selects the format"""
    prim: Annotated[str | None, option("/PRIM")] = None
    """field to write or read; default: one named after the file, or the whole stage"""
    json: Annotated[bool, option()] = False
    """print one JSON object with a report"""
    stage_output: StageWritten = field(default_factory=StageWritten)
    stage_input: StageRead = field(default_factory=StageRead)
    view: ViewOptions = field(default_factory=ViewOptions)
    sequence: Frames = field(default_factory=Frames)
    capture: Captures = field(default_factory=Captures)
    edit: EditFlags = field(default_factory=EditFlags)
    job: JobOptions = field(default_factory=JobOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


_OF_VIEW = ("camera", "lod_error", "splat_budget", "resolution")
_MEANINGFUL = {
    (False, True): (
        *("packed", "half", "up_axis", "axes", "meters_per_unit", "prim", "bake_axes", "lod"),
    ),
    (True, False): ("prim", "axes", "lod", "max_splats", "spz_version", *_OF_VIEW),
    (False, False): ("axes", "lod", "spz_version"),
    (True, True): ("packed", "half", "flatten"),
}
"""(input is a stage, output is a stage) -> flags that apply."""
_OF_ONE = {(False, True): ("cameras",), (True, False): ("frame", "split")}
"""The same for inputs and outputs that are not sequences."""
_OF_FRAMES = {
    (False, True): ("frames", "clips", "rate", "interpolate"),
    (True, False): ("frames",),
    (False, False): ("frames",),
}
"""The same for sequences."""
_OF_PAGE = {
    True: (
        *("prim", "frame", "frames", "camera", "resolution", "background", "lod", "max_splats"),
    ),
    False: ("axes", "lod", "resolution", "background"),
}
"""Input is a stage -> flags that apply to pages."""


def switches() -> set[str]:
    """Return the options that take no value."""
    groups = (Options, StageWritten, StageRead, Frames, Captures, ReportingOptions)
    off = [item.name for group in groups for item in fields(group) if item.default is False]
    return {"--help", "-h", "-q", "-v", *map(_flag, off)}


def check(options: Options, sources: Sequence[Path], target: str) -> None:
    """Raise an error for a flag that has no effect or an invalid value.

    Raises:
        UsageError: If there is such a flag.
        UnknownFormatError: If the target has no format that can be written.
        OutputError: If the target is a folder.
    """
    from usdsplat.formats.options import SPZ_VERSIONS
    from usdsplat.images.frame_numbers import has_place
    from usdsplat.interchange.converting import check_sequences, check_target
    from usdsplat.interchange.files import is_page, is_usd
    from usdsplat.interchange.sequence_files import is_sequence

    if is_page(target):
        _check_page(options, sources, target)
        return
    becomes = is_usd(check_target(target))
    check_sequences(sources, Path(target))
    kinds = sorted({(is_usd(source), becomes) for source in sources})
    of_frames = any(map(is_sequence, sources)) or (has_place(target) and not becomes)
    tables = (_MEANINGFUL, _OF_FRAMES if of_frames else _OF_ONE)
    found = (name for kind in kinds for table in tables for name in table.get(kind, ()))
    meaningful = list(dict.fromkeys(found))
    for name in _given(options):
        if name not in meaningful:
            words = ["a stage" if kind else "a capture" for kind in (kinds[0][0], becomes)]
            said = f"{words[0]} that becomes {words[1]}" + (", frame by frame" if of_frames else "")
            listed = ", ".join(map(_flag, meaningful))
            raise UsageError(_flag(name), f"it with {said}", f"only {listed}, or edits")
    _check_levels(options)
    version = options.capture.spz_version
    _check_view(options, sources)
    if version is not None and not target.lower().endswith(".spz"):
        raise UsageError("--spz-version", target, "an .spz to write")
    if version not in (None, *SPZ_VERSIONS):
        raise UsageError("--spz-version", str(version), " or ".join(map(str, SPZ_VERSIONS)))


def _check_page(options: Options, sources: Sequence[Path], target: str) -> None:
    """Raise an error for a flag that a page does not have, or an invalid value.

    Raises:
        UsageError: If there is one.
    """
    from usdsplat.images.frame_numbers import has_place
    from usdsplat.interchange.files import is_usd
    from usdsplat.interchange.sequence_files import is_sequence

    for name in (str(each) for each in (*sources, target)):
        if is_sequence(Path(name)) or has_place(name):
            raise UsageError(name, "a placeholder for the frame number", "none with a page")
    is_stage = any(map(is_usd, sources))
    meaningful = _OF_PAGE[is_stage]
    for name in _given(options):
        if name not in meaningful:
            said = f"it with {'a stage' if is_stage else 'a capture'} that becomes a page"
            listed = ", ".join(map(_flag, meaningful))
            raise UsageError(_flag(name), said, f"only {listed}, or edits")
    _check_levels(options)


def _check_levels(options: Options) -> None:
    """Raise an error for an invalid choice of levels of detail."""
    lod, most = options.capture.lod, options.stage_input.max_splats
    if lod is not None and lod < 0:
        raise UsageError("--lod", str(lod), "a level, 0 the finest")
    if most is not None and most < 1:
        raise UsageError("--max-splats", str(most), "at least 1")


def _check_view(options: Options, sources: Sequence[Path]) -> None:
    """Raise an error for flags of a view that have no effect, or contradict others.

    Raises:
        UsageError: If there is one.
    """
    for name in _given(options):
        if options.view.camera is None and name in _OF_VIEW:
            raise UsageError(_flag(name), "no --camera", "the camera of the view")
        if options.view.camera is not None and name in ("lod", "max_splats"):
            raise UsageError("--camera", f"{_flag(name)} too", "one of them")
    if options.view.camera is not None and len(sources) > 1:
        raise UsageError("--camera", f"{len(sources)} inputs", "one stage")


def _given(options: Options) -> Iterator[str]:
    """Yield the names of the flags whose value is not the default."""
    groups: tuple[Any, ...] = (
        *(options.stage_output, options.stage_input, options.view),
        *(options.sequence, options.capture),
    )
    for group in groups:
        for item in fields(group):
            if getattr(group, item.name) != item.default:
                yield item.name
    if options.prim is not None:
        yield "prim"


def _flag(name: str) -> str:
    """Return the flag of a field."""
    return f"--{name.replace('_', '-')}"
