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
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core.findings import Findings
from usdsplat.core.wording import counted


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat validate`."""

    stage: Annotated[Path, positional("STAGE")]
    """stage to check"""
    frame: Annotated[float | None, option("FRAME")] = None
    """check only this time code; default: every sample"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the findings"""
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Print the findings. Return 1 for errors, and in a strict run for warnings; otherwise 0."""
    from usdsplat.interchange.opening import open_as_asked
    from usdsplat.schema import validate
    from usdsplat.schema.composition import composition_findings
    from usdsplat.sim.stage.validating import validate_simulations

    time, opening = time_code(options.frame), options.opening
    with reporter.progress() as progress:
        stage = open_as_asked(
            options.stage,
            variants=opening.variant,
            mute=opening.mute,
            mask=opening.mask,
            session_layer=opening.session_layer,
        )
        findings = Findings(is_strict=options.reporting.strict)
        findings.extend(composition_findings(stage))
        findings.extend(validate(stage, time=time, progress=progress))
        findings.extend(validate_simulations(stage, time=time))
    errors, warnings = findings.count("error"), findings.count("warning")
    if options.json:
        console.print_json({"findings": [asdict(finding) for finding in findings]})
    else:
        for finding in filter(reporter.is_shown, findings):
            print(f"{finding.told}\n  cure: {finding.cure}")
            if finding.rule:
                print(f"  rule: {finding.rule} of NVIDIA's validator for splats")
        print(f"{options.stage}: {counted(errors, 'error')}, {counted(warnings, 'warning')}")
    return 1 if errors or (findings.is_strict and findings.is_failure) else 0
