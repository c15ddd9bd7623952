"""Check stages for everything that other commands would stop at or complain of.

examples:
  usdsplat validate shot.usd
      check every time sample of every field; exit status 1 if there are errors
  usdsplat validate shots/*.usd --strict
      check many stages; exit status 1 also if there are warnings
  usdsplat validate shot.usd --frame 12
      check one frame only, which is faster
  usdsplat validate shot.usd --json
  usdsplat validate shot.usd --variant /World/Tree:season=autumn --mute proxy

notes:
  An error means that the picture is wrong or missing, or that the stage cannot be simulated. A
  warning means that other applications have a problem, or that a setting has no effect. Each
  finding has a code; all are listed in docs/reference/findings.md.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core.errors import UsageError, UsdSplatError
from usdsplat.core.findings import Finding, Findings, from_error
from usdsplat.core.progress import Progress
from usdsplat.core.text import shown
from usdsplat.core.wording import counted


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat validate`."""

    stages: Annotated[tuple[Path, ...], positional("[STAGE ...] STAGE")]
    """stages to check"""
    frame: Annotated[float | None, option("FRAME")] = None
    """check only this time code; default: every sample"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the findings and with how much was checked"""
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Print the findings. Return 1 for errors, and in a strict run for warnings; otherwise 0."""
    from usdsplat.kernels.compiling import on_compile

    reporter.printed = everything = Findings(is_strict=options.reporting.strict)
    total: Counter[str] = Counter(files=len(options.stages))
    with reporter.progress() as progress, on_compile(reporter.announce_compilation()):
        for path in options.stages:
            findings, looked_at = _checked(path, options, progress)
            everything.extend(findings)
            total += looked_at
            if not options.json:
                _show(path, findings, looked_at, reporter)
    if options.json:
        reporter.print_json({"looked_at": dict(total)})
    elif len(options.stages) > 1:
        console.say(f"{counted(len(options.stages), 'file')}: {_amounts(everything)}")
    is_failure = everything.is_strict and everything.is_failure
    return 1 if is_failure or everything.count("error") else 0


def _checked(path: Path, options: Options, progress: Progress) -> tuple[Findings, Counter[str]]:
    """Return the findings on a stage, and how much was checked.

    Raises:
        UsdSplatError: If the only stage cannot be opened; one of several is a finding, and so is
            the only one with --json.
    """
    from usdsplat.interchange.opening import open_as_asked
    from usdsplat.products.checking import check_stage

    found: list[Finding] = []
    looked_at: Counter[str] = Counter()
    opening, is_only = options.opening, len(options.stages) == 1
    collected = Findings(found.append)
    try:
        stage = open_as_asked(
            path,
            variants=opening.variant,
            mute=opening.mute,
            mask=opening.mask,
            session_layer=opening.session_layer,
        )
        time = time_code(options.frame)
        looked_at = check_stage(stage, collected, time=time, progress=progress)
    except UsageError:
        raise
    except UsdSplatError as error:
        if is_only and not options.json:
            raise
        collected.add(replace(from_error("unreadable", error), path=str(path), attribute=""))
    findings = Findings()
    findings.extend(each if is_only else replace(each, file=str(path)) for each in found)
    return findings, looked_at


def _show(path: Path, findings: Findings, looked_at: Counter[str], reporter: Reporter) -> None:
    """Print the findings on a stage, and how much was checked."""
    for each in filter(reporter.is_shown, findings):
        console.say(f"{shown(each.told)}\n  cure: {shown(each.cure)}")
        if each.rule:
            console.say(f"  rule: {each.rule} of NVIDIA's validator for splats")
    listed = [counted(number, kind[:-1]) for kind, number in looked_at.items() if number]
    end = f"; looked at {', '.join(listed)}" if listed else ""
    console.say(f"{shown(path)}: {_amounts(findings)}{end}")


def _amounts(findings: Findings) -> str:
    """Return the numbers of errors and warnings as text."""
    errors, warnings = findings.count("error"), findings.count("warning")
    return f"{counted(errors, 'error')}, {counted(warnings, 'warning')}"
