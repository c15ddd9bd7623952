"""Check the splats and simulations of a stage, and say how to fix each problem.

examples:
  usdsplat validate shot.usd
      check every time sample of every field; exit status 1 if there are errors
  usdsplat validate shot.usd --frame 12
      check one frame only, which is faster
  usdsplat validate shot.usd --json
  usdsplat validate shot.usd --variant /World/Tree:season=autumn --mute proxy

notes:
  An error means that the picture is wrong or missing, or that the stage cannot be simulated. A
  warning means that other applications have a problem, or that a setting has no effect.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core.text import shown
from usdsplat.core.wording import counted


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat validate`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage to check"""
    frame: Annotated[float | None, option("FRAME")] = None
    """check only this time code; default: every sample"""
    json: Annotated[bool, option()] = False
    """print one JSON list of findings"""
    opening: StageOptions = field(default_factory=StageOptions)


def run(options: Options) -> int:
    """Print the findings. Return 1 if there are errors, otherwise 0."""
    from usdsplat.cli.stages import open_stage
    from usdsplat.schema import validate
    from usdsplat.sim.stage.validating import validate_simulations

    time = time_code(options.frame)
    with console.progress() as progress:
        stage = open_stage(options.stage, options.opening)
        findings = validate(stage, time=time, progress=progress)
        findings += validate_simulations(stage, time=time)
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = len(findings) - errors
    if options.json:
        console.print_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            console.say(
                f"{finding.severity}: {shown(finding.message)}\n  cure: {shown(finding.cure)}"
            )
            if finding.rule:
                console.say(f"  rule: {finding.rule} of NVIDIA's validator for splats")
        console.say(
            f"{shown(options.stage)}: {counted(errors, 'error')}, {counted(warnings, 'warning')}"
        )
    return 1 if errors else 0
