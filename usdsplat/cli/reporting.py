"""Report the findings of a command: on stderr, in --json, and as exit status with --strict.

Messages of USD and of Python libraries during a command are findings too; without --verbose they
are not printed.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from usdsplat.cli import console
from usdsplat.cli.arguments import option
from usdsplat.cli.progress import checked_style, listening
from usdsplat.core.errors import StrictError
from usdsplat.core.findings import LIBRARY_MESSAGES, Finding, Findings, finding
from usdsplat.core.progress import Progress, silent
from usdsplat.core.text import shown

if TYPE_CHECKING:
    from usdsplat.products.keeper import EngineKeeper

_CONTEXT = re.compile(r" \([a-z ]+ on stage @.*\)$")
"""End of a message of USD with the stage's address."""
_PATH = re.compile(r"<([^<>]*)>")
"""A path in a message of USD."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportingOptions:
    """What is printed on stderr, and what follows from findings."""

    strict: Annotated[bool, option()] = False
    """exit with status 1 and write nothing if the stage asks for something that it does not get"""
    quiet: Annotated[bool, option(short="-q", excludes="--verbose")] = False
    """print only results, errors, and findings that are errors"""
    progress: Annotated[str, option("auto|json|openjd")] = "auto"
    """progress on stderr: a bar or plain lines, one JSON object per line, or lines that Open Job
    Description workers read"""
    verbose: Annotated[bool, option(short="-v")] = False
    """also print the cure of each finding, and messages of USD and other libraries"""


class Reporter:
    """Printer of the findings and messages of one command."""

    def __init__(
        self,
        options: ReportingOptions,
        arguments: Sequence[str] = (),
        keeper: EngineKeeper | None = None,
    ) -> None:
        self.arguments = tuple(arguments)
        """The command line after the program's name."""
        self.keeper = keeper
        """Keeps the stage of the command open for the next one; None closes it."""
        self._quiet = options.quiet
        self._verbose = options.verbose
        self._style = checked_style(options.progress)
        self.findings = Findings(self._tell, say=self.remark, is_strict=options.strict)
        """Collector of the findings; each is printed when it is new."""
        self.printed: Iterable[Finding] = ()
        """Findings that the command prints itself; they are only added to the JSON."""
        self._json: dict[str, Any] | None = None

    @property
    def is_of_farm(self) -> bool:
        """Whether a farm runs the command as a task of an Open Job Description bundle."""
        return self._style == "openjd"

    def remark(self, text: str) -> None:
        """Print a message that is neither a result, nor an error, nor a finding."""
        if not self._quiet:
            console.remark(text)

    def progress(
        self, compiled: Callable[[], float] = lambda: 0.0
    ) -> AbstractContextManager[Progress]:
        """Return a progress listener for stderr; with --quiet one that shows nothing."""
        return nullcontext(silent) if self._quiet else listening(compiled, self._style)

    def announce_compilation(self, text: str = console.PICTURES) -> Callable[[str], None]:
        """Return a function to call for each compiled kernel, see `console`."""
        return (lambda kernel: None) if self._quiet else console.announce_compilation(text)

    def everything(self) -> list[Finding]:
        """Return all findings of the command."""
        return [*self.printed, *self.findings]

    def print_json(self, value: dict[str, Any]) -> None:
        """Print an object as JSON at the end of the command, with all findings."""
        self._json = value

    def finish(self) -> None:
        """Print the JSON object of the command, if there is one, with all findings added."""
        if self._json is not None:
            findings = [asdict(each) for each in self.everything()]
            console.print_json({**self._json, "findings": findings})

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
    """Module of a command, see `main`; its options have a field `reporting`, if it has flags for
    that.

    A module that does not use USD has the constant USES_USD = False.
    """

    Options: type

    def run(self, options: Any, reporter: Reporter) -> int:
        """Run the command and return the exit status."""


def reported(
    command: Command,
    options: Any,
    arguments: Sequence[str] = (),
    *,
    keeper: EngineKeeper | None = None,
) -> int:
    """Run a command, report its findings, and return the exit status.

    Args:
        command: Its module.
        options: Its options.
        arguments: The command line after the program's name.
        keeper: Keeps the stage of the command open for the next one.

    Returns:
        That of the command; 1 if the command is strict and there is an error or a warning.
    """
    reporter = Reporter(getattr(options, "reporting", ReportingOptions()), arguments, keeper)
    findings = reporter.findings
    uses_usd = getattr(command, "USES_USD", True)
    try:
        with library_messages(reporter) if uses_usd else nullcontext():
            status = command.run(options, reporter)
    except StrictError as error:
        console.remark(str(error))
        if getattr(options, "json", False):
            reporter.print_json({})
            reporter.finish()
        return 1
    reporter.finish()
    return 1 if status == 0 and findings.is_strict and findings.is_failure else status


_collecting: list[list[Any]] = []
"""Lists with the delegate of each `library_messages`, the only reference to it."""


def leave_messages() -> None:
    """End what `library_messages` collects, in a process that was forked in its context and does
    not leave it."""
    for told in _collecting:
        told.clear()
    _collecting.clear()


@contextmanager
def library_messages(reporter: Reporter) -> Iterator[None]:
    """Collect messages of USD and warnings of Python libraries as findings, instead of printing.

    Messages that repeat a finding on composition are dropped. Errors of USD that it raises as
    exceptions are not affected.
    """
    from pxr import UsdUtils

    findings = reporter.findings
    told = [UsdUtils.CoalescingDiagnosticDelegate()]
    _collecting.append(told)
    with warnings.catch_warnings(record=True) as warned:
        try:
            yield
        finally:
            known = _Known(reporter.everything())
            _collecting.remove(told)
            for each in told.pop().TakeUncoalescedDiagnostics():
                text = _CONTEXT.sub("", " ".join(str(each.commentary).split()))
                if text not in known:
                    findings.add(finding("usd-message", "USD", text, "no message"))
            for each in warned:
                where = f"{each.filename}:{each.lineno}"
                text = f"{each.category.__name__}: {each.message}"
                findings.add(finding("python-warning", where, text, "no warning", attribute=""))


class _Known:
    """The composition problems that are known as findings, to look up messages of USD."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        codes = ("missing-asset", "missing-prim", "composition")
        known = [each for each in findings if each.code in codes]
        self._paths = {each.path for each in known}
        self._found = "\n".join({each.found for each in known})

    def __contains__(self, text: str) -> bool:
        """Return whether a message is about a muted layer, or about an asset or a prim path of a
        finding."""
        if " was muted " in text:
            return True
        asset = next((part for part in text.split("@")[1::2] if part), None)
        if asset is not None and asset in self._found:
            return True
        return not self._paths.isdisjoint(_PATH.findall(text))
