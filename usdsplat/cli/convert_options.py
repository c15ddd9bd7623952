"""Options of `convert`, and which of them mean something for what is to become what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from usdsplat.cli.arguments import option, positional
from usdsplat.cli.edit_flags import EditFlags
from usdsplat.core.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class StageWritten:
    """How a stage is written."""

    packed: Annotated[bool, option(excludes="--half")] = False
    """store fields in our compact type: 28 bytes a splat at degree 0, 76 at degree 3; not with
    --half"""
    half: Annotated[bool, option()] = False
    """store fields as stock half floats, centres as floats: 124 bytes a splat at degree 3"""
    up_axis: Annotated[str | None, option("Y|Z")] = None
    """of a stage made from a capture; default: Y"""
    meters_per_unit: Annotated[float | None, option("METRES")] = None
    """how long a unit of the capture is; default: 1"""
    bake_axes: Annotated[bool, option()] = False
    """turn the splats themselves, harmonics included, instead of adding a transform"""
    cameras: Annotated[Path | None, option("PATH")] = None
    """poses of the photographs, which become cameras beside the field: a folder of COLMAP, or the
    transforms.json of instant-ngp or nerfstudio"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRead:
    """What of a stage is read."""

    frame: Annotated[float | None, option("FRAME")] = None
    """time code to read of a stage; default: its default values, or the first samples"""
    split: Annotated[bool, option()] = False
    """write each field to a file of its own, OUT with the prim's name before the suffix"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Sequences: IN or OUT with a place for the frame number, such as cap.####.ply."""

    frames: Annotated[str | None, option("RANGE")] = None
    """such as 7, 1-10, 1:10x2 or 1,5,8-12; default: all there are"""
    clips: Annotated[bool, option()] = False
    """write value clips, a file for each frame in a folder beside OUT, not time samples"""
    rate: Annotated[float | None, option("FPS")] = None
    """frames in a second of a sequence that becomes a stage; default: 24"""
    interpolate: Annotated[bool, option()] = False
    """take a splat for the same in all frames if its row is: between frames it moves"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Captures:
    """How captures are read and written."""

    axes: Annotated[str | None, option("AXES")] = None
    """to a stage: where x, y and z of the input point, default as the file says; to a capture:
    where those of the output are to point, default as is usual in its format"""
    lod: Annotated[int | None, option("LEVEL")] = None
    """level of a capture that has several to read, 0 the finest; default: 0"""
    spz_version: Annotated[int | None, option("3|4")] = None
    """of an .spz to write; default: 4"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat convert`."""

    source: Annotated[str, positional("IN")]
    """capture or USD file to read"""
    others: Annotated[tuple[str, ...], positional("[IN ...] OUT")]
    """more to read into the same output, and the file to write; its suffix says what it becomes"""
    prim: Annotated[str | None, option("/PRIM")] = None
    """the field to write to or read from; default: one named as the file, or the whole stage"""
    json: Annotated[bool, option()] = False
    """print one JSON object about what was done"""
    stage_written: StageWritten = field(default_factory=StageWritten)
    stage_read: StageRead = field(default_factory=StageRead)
    sequences: Frames = field(default_factory=Frames)
    captures: Captures = field(default_factory=Captures)
    edits: EditFlags = field(default_factory=EditFlags)


_MEANINGFUL = {
    (False, True): (
        *("packed", "half", "up_axis", "axes", "meters_per_unit", "prim", "bake_axes", "lod"),
    ),
    (True, False): ("prim", "axes", "spz_version"),
    (False, False): ("axes", "lod", "spz_version"),
    (True, True): ("packed", "half"),
}
"""Whether input and output are stages -> the flags that mean something."""
_OF_ONE = {(False, True): ("cameras",), (True, False): ("frame", "split")}
"""Likewise, of what is no sequence."""
_OF_FRAMES = {
    (False, True): ("frames", "clips", "rate", "interpolate"),
    (True, False): ("frames",),
    (False, False): ("frames",),
}
"""Likewise, of a sequence."""


def switches() -> set[str]:
    """Options that take no value."""
    groups = (Options, StageWritten, StageRead, Frames, Captures)
    off = [item.name for group in groups for item in fields(group) if item.default is False]
    return {"--help", "-h", *map(_flag, off)}


def check(options: Options, sources: Sequence[Path], target: str) -> None:
    """Refuse a flag that would change nothing, or has a value that it cannot have.

    Raises:
        UsageError: If there is one.
        UnknownFormatError: If the target says nothing that can be written.
        OutputError: If it says that it is a folder.
    """
    from usdsplat.formats.options import SPZ_VERSIONS
    from usdsplat.images.frames import has_place
    from usdsplat.interchange.converting import check_sequences, check_target
    from usdsplat.interchange.files import is_usd
    from usdsplat.interchange.sequence_files import is_sequence

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
    lod, version = options.captures.lod, options.captures.spz_version
    if lod is not None and lod < 0:
        raise UsageError("--lod", str(lod), "a level, 0 the finest")
    if version is not None and not target.lower().endswith(".spz"):
        raise UsageError("--spz-version", target, "an .spz to write")
    if version not in (None, *SPZ_VERSIONS):
        raise UsageError("--spz-version", str(version), " or ".join(map(str, SPZ_VERSIONS)))


def _given(options: Options) -> Iterator[str]:
    """Names of the flags with another value than their default."""
    groups: tuple[Any, ...] = (
        *(options.stage_written, options.stage_read, options.sequences, options.captures),
    )
    for group in groups:
        for item in fields(group):
            if getattr(group, item.name) != item.default:
                yield item.name
    if options.prim is not None:
        yield "prim"


def _flag(name: str) -> str:
    """A field as it is typed."""
    return f"--{name.replace('_', '-')}"
