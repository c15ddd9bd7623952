"""Say what is in a capture or a stage.

examples:
  usdsplat info scan.ply
      how many splats, how large, what format, which axes, how exact
  usdsplat info shot.usd
      every splat field with its numbers, and cameras, frames and render products
  usdsplat info shot.usd --time 12
  usdsplat info scan.sog --json
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from usdsplat.cli import console
from usdsplat.cli.parsing import option
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat info`."""

    file: Annotated[Positional[Path], option("FILE")]
    """capture or stage to look at"""
    time: Annotated[float | None, option("FRAME")] = None
    """time code at which a stage is read; default: default values, or the first samples"""
    json: Annotated[bool, option()] = False
    """print one JSON object"""
    opening: Annotated[StageOptions, arg(name="")] = field(default_factory=StageOptions)


def run(options: Options) -> int:
    """Print a description of the file."""
    from usdsplat.cli import summary
    from usdsplat.cli.stages import check_no_stage_options, open_stage
    from usdsplat.interchange.files import is_usd

    time = time_code(options.time)
    with console.progress() as progress:
        if is_usd(options.file):
            stage = open_stage(options.file, options.opening)
            described = summary.of_stage(stage, time, progress=progress)
        else:
            check_no_stage_options(options.file, options.opening)
            if time is not None:
                raise UsageError("--time", f"a capture, {options.file}", "a stage")
            described = summary.of_capture(options.file, progress=progress)
    described = {"file": str(options.file), **described}
    if options.json:
        console.print_json(described)
    else:
        print("\n".join(_lines(described, "")))
    return 0


def _lines(value: dict[str, Any], indent: str) -> list[str]:
    """A description as indented text; what says nothing is left out."""
    lines = []
    for key, item in value.items():
        name = key.replace("_", " ")
        if item is None or item is False or item in ([], {}, ""):
            continue
        if isinstance(item, list) and isinstance(item[0], dict):
            for entry in item:
                lines += [f"{indent}{name}", *_lines(entry, indent + "  ")]
        elif isinstance(item, list) and isinstance(item[0], str):
            lines += [f"{indent}{name:<18} {entry}" for entry in item]
        elif isinstance(item, dict) and any(isinstance(v, str) for v in item.values()):
            lines += [f"{indent}{name}", *_lines(item, indent + "  ")]
        else:
            lines.append(f"{indent}{name:<18} {_text(item)}")
    return lines


def _text(item: Any) -> str:
    """One value as people read it."""
    if isinstance(item, dict):
        return "  ".join(f"{key} {_text(entry)}" for key, entry in item.items())
    if isinstance(item, list):
        return " ".join(f"({_text(e)})" if isinstance(e, list) else _text(e) for e in item)
    if isinstance(item, bool):
        return "yes"
    return f"{item:.6g}" if isinstance(item, float) else str(item)
