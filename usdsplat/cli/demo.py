"""Make a capture, a stage, pictures and sequences, as a tour of the features.

examples:
  usdsplat demo
      a generated still life, in ./demo
  usdsplat demo scan.ply -o /tmp/demo
      the same with your own capture
  usdsplat demo --splats 1000000 --frames 100

notes:
  The stages can be opened in usdview and in any other application with USD 26.3 or later.
  The simulation uses a capture of up to 300,000 splats, or a generated one with fewer splats.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.core.text import shown

COMPILING = "compiling kernels, once for this machine; it takes a minute or two"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat demo`."""

    capture: Annotated[Path | None, positional("[CAPTURE]")] = None
    """capture to use; default: a generated one"""
    output: Annotated[Path, option("DIR", short="-o")] = Path("demo")
    """output folder, created if it is missing; default: demo"""
    splats: Annotated[int, option("N")] = 200_000
    """approximate number of splats of the generated capture; default: 200000"""
    frames: Annotated[int, option("N")] = 24
    """length of each sequence; default: 24"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    json: Annotated[bool, option()] = False
    """print one JSON object with the files and a description of each"""
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


@dataclass(slots=True, kw_only=True)
class Results:
    """Printer of finished files, one by one or as JSON at the end."""

    is_json: bool
    told: list[dict[str, str]] = field(default_factory=list)

    def tell(self, path: Path, text: str) -> None:
        """Report one file."""
        self.told.append({"path": str(path), "text": text})
        if not self.is_json:
            console.say(f"{shown(path):<28} {text}")

    def finish(self, advice: str, reporter: Reporter) -> None:
        """Print the advice, or the JSON list of files."""
        if self.is_json:
            reporter.print_json({"files": self.told})
        else:
            console.say(advice)


def run(options: Options, reporter: Reporter) -> int:
    """Run the demo. Print each file with a description."""
    from usdsplat.kernels.compiling import compile_time, on_compile
    from usdsplat.products.demo import DemoRequest, make_demo

    results = Results(is_json=options.json)
    request = DemoRequest(
        capture=options.capture,
        folder=options.output,
        splats=options.splats,
        frames=options.frames,
        threads=options.threads,
    )
    with (
        compile_time() as compiled,
        reporter.progress(compiled) as progress,
        on_compile(reporter.announce_compilation(COMPILING)),
    ):
        stage = make_demo(request, progress=progress, tell=results.tell)
    results.finish(f"next: usdsplat info {stage}", reporter)
    return 0
