"""Make a capture, a stage, pictures and sequences, to see it all work.

examples:
  usdsplat demo
      a still life of our own, into ./demo
  usdsplat demo scan.ply -o /tmp/demo
      the same with a capture of yours
  usdsplat demo --splats 1000000 --frames 100

notes:
  The stages it leaves open in usdview and in every other application of USD 26.3 or later.
  A pattern grows on a capture of up to 300,000 splats, or on a coarser model of our own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional

COMPILING = "compiling kernels, once for this machine; it takes a minute or two"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat demo`."""

    capture: Annotated[Path | None, positional("[CAPTURE]")] = None
    """capture to use; default: one that is modelled for the occasion"""
    output: Annotated[Path, option("DIR", short="-o")] = Path("demo")
    """folder to fill, made if it is missing; default: demo"""
    splats: Annotated[int, option("N")] = 200_000
    """how detailed our own capture is; default: about 200000"""
    frames: Annotated[int, option("N")] = 24
    """length of each sequence; default: 24"""
    threads: Annotated[int | None, option("N")] = None
    """how many to use; default: all"""
    json: Annotated[bool, option()] = False
    """print one JSON list of the files and what each is"""


@dataclass(slots=True, kw_only=True)
class Results:
    """Files that were made, printed as they are finished, or as JSON at the end."""

    is_json: bool
    told: list[dict[str, str]] = field(default_factory=list)

    def tell(self, path: Path, text: str) -> None:
        """Note one file."""
        self.told.append({"path": str(path), "text": text})
        if not self.is_json:
            print(f"{path!s:<28} {text}", flush=True)

    def finish(self, advice: str) -> None:
        """Print the advice, or the JSON list of files."""
        if self.is_json:
            console.print_json(self.told)
        else:
            print(advice)


def run(options: Options) -> int:
    """Run the main job from end to end; print each result with what it is."""
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
        console.progress(compiled) as progress,
        on_compile(console.announce_compilation(COMPILING)),
    ):
        stage = make_demo(request, progress=progress, tell=results.tell)
    results.finish(f"next: usdsplat info {stage}")
    return 0
