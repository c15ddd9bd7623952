"""Report the findings of a command: on stderr, in --json, and as exit status with --strict.

Messages of USD and of Python libraries during a command are findings too; without --verbose they
are not printed.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Protocol

from usdsplat.cli import console
from usdsplat.cli.arguments import option
from usdsplat.core.errors import StrictError
from usdsplat.core.findings import LIBRARY_MESSAGES, Finding, Findings, finding
from usdsplat.core.progress import Progress, silent
from usdsplat.core.text import shown

_CONTEXT = re.compile(r" \([a-z ]+ on stage @.*\)$")
"""End of a message of USD with the stage's address."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportingOptions:
    """What is printed on stderr, and what follows from findings."""

    strict: Annotated[bool, option()] = False
    """exit with status 1 and write nothing if the stage asks for something that it does not get"""
    quiet: Annotated[bool, option(short="-q", excludes="--verbose")] = False
    """print only results, errors, and findings that are errors"""
    verbose: Annotated[bool, option(short="-v")] = False
    """also print the cure of each finding, and messages of USD and other libraries"""


class Reporter:
    """Printer of the findings and messages of one command."""

    def __init__(self, options: ReportingOptions) -> None:
        self._quiet = options.quiet
        self._verbose = options.verbose
        self.findings = Findings(self._tell, say=self.remark, is_strict=options.strict)
        """Collector of the findings; each is printed when it is new."""

    @property
    def is_quiet(self) -> bool:
        """Whether only results and errors are printed."""
        return self._quiet

    def remark(self, text: str) -> None:
        """Print a message that is neither a result, nor an error, nor a finding."""
        if not self._quiet:
            console.remark(text)

    def progress(
        self, compiled: Callable[[], float] = lambda: 0.0
    ) -> AbstractContextManager[Progress]:
        """Return a progress listener, see `console.progress`."""
        return nullcontext(silent) if self._quiet else console.progress(compiled)

    def announce_compilation(self, text: str = console.PICTURES) -> Callable[[str], None]:
        """Return a function to call for each compiled kernel, see `console`."""
        return (lambda kernel: None) if self._quiet else console.announce_compilation(text)

    def print_json(self, value: dict[str, Any]) -> None:
        """Print an object as JSON, with the findings so far."""
        console.print_json({**value, "findings": [asdict(each) for each in self.findings]})

    def is_shown(self, found: Finding) -> bool:
        """Return whether a finding is printed."""
        if self._quiet:
            return found.severity == "error"
        return self._verbose or found.code not in LIBRARY_MESSAGES

    def lines(self, found: Finding) -> list[str]:
        """Return a finding as lines of text; the cure only with --verbose."""
        return [found.told, *([f"  cure: {found.cure}"] if self._verbose else [])]

    def _tell(self, found: Finding) -> None:
        if self.is_shown(found):
            first, *others = map(shown, self.lines(found))
            console.tell("\n".join([f"usdsplat: {first}", *others]))


class Command(Protocol):
    """Module of a command, see `main`; its options have a field `reporting`.

    A module that does not use USD has the constant USES_USD = False.
    """

    Options: type

    def run(self, options: Any, reporter: Reporter) -> int:
        """Run the command and return the exit status."""


def reported(command: Command, options: Any) -> int:
    """Run a command, report its findings, and return the exit status.

    Returns:
        That of the command; 1 if the command is strict and there is an error or a warning.
    """
    reporter = Reporter(options.reporting)
    findings = reporter.findings
    uses_usd = getattr(command, "USES_USD", True)
    try:
        with library_messages(findings) if uses_usd else nullcontext():
            status = command.run(options, reporter)
    except StrictError as error:
        console.remark(str(error))
        if getattr(options, "json", False):
            reporter.print_json({})
        return 1
    return 1 if status == 0 and findings.is_strict and findings.is_failure else status


@contextmanager
def library_messages(findings: Findings) -> Iterator[None]:
    """Collect messages of USD and warnings of Python libraries as findings, instead of printing.

    Messages that repeat a finding on composition are dropped. Errors of USD that it raises as
    exceptions are not affected.
    """
    from pxr import UsdUtils

    told = UsdUtils.CoalescingDiagnosticDelegate()
    with warnings.catch_warnings(record=True) as warned:
        try:
            yield
        finally:
            for each in told.TakeUncoalescedDiagnostics():
                text = _CONTEXT.sub("", " ".join(str(each.commentary).split()))
                if not _is_known(text, findings):
                    findings.add(finding("usd-message", "USD", text, "no message"))
            for each in warned:
                where = f"{each.filename}:{each.lineno}"
                text = f"{each.category.__name__}: {each.message}"
                findings.add(finding("python-warning", where, text, "no warning"))


def _is_known(text: str, findings: Findings) -> bool:
    """Return whether a message of USD is about a muted layer, or about an asset or a prim path of a
    finding."""
    if " was muted " in text:
        return True
    assets = [part for part in text.split("@")[1::2] if part]
    known = [each for each in findings if each.code in ("missing-asset", "missing-prim")]
    known += [each for each in findings if each.code == "composition"]
    return any(
        f"<{each.path}>" in text or any(asset in each.found for asset in assets[:1])
        for each in known
    )
