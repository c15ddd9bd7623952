"""Findings: what a file asks for and does not get, each with a code and a cure.

Every command reports the same finding with the same code and the same words. `CODES` is the only
table of codes; the page docs/reference/findings.md is generated from it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

from usdsplat.core.errors import (
    FormatError,
    OutputError,
    StrictError,
    UnknownFormatError,
    UsdSplatError,
)
from usdsplat.core.finding_codes import CODES, LIBRARY_MESSAGES, Severity
from usdsplat.core.wording import counted

__all__ = [
    "CODES",
    "LIBRARY_MESSAGES",
    "STRICT",
    "Finding",
    "Findings",
    "Severity",
    "finding",
    "from_error",
]

STRICT: tuple[Severity, ...] = ("error", "warning")
"""Severities that a strict command does not accept."""

_PROPERTY = re.compile(
    r"((?:/[^\W\d]\w*(?:\{\w+=\w*\})*)+)(?:\.(?=[^\W\d])|\s(?=[^\W\d][^/.]*$))(.*)"
)
"""Path of a prim, and the attribute or part of it that follows."""
_FILE = re.compile(
    r"(?:.*\.)?(?:usd[acz]?|exr|png|jpe?g|tiff?|hdr|tx|ply|spz|sog|splat|ksplat|glb|gltf|json|ocio|"
    r"txt|py)(?::\d+)?(?:\s.*)?",
    re.IGNORECASE,
)
"""Text after the last full stop of a location if the location is a file, such as "usda" or "py:12".

Otherwise the text is the name of an attribute."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Something that a file asks for and does not get, with its cure."""

    code: str
    """Key of `CODES`, shared by all findings with the same cure."""
    severity: Severity
    """An error changes the picture or prevents it; a warning may do so in other applications, or
    has no effect where one is expected; a note is for information."""
    path: str
    """Path of the prim, or the name of something that is no prim."""
    attribute: str = ""
    """Attribute or collection concerned; "" for the prim as a whole."""
    found: str
    expected: str
    cure: str
    time: float | None = None
    """Time code of the first affected sample or frame; None for a value that does not change, or
    the first frame."""
    samples: int = 1
    """Number of affected samples."""
    rule: str = ""
    """Published rule that it violates, see `schema.validation.published`; "" for none."""
    file: str = ""
    """File that was checked; "" if there is only one."""

    @property
    def message(self) -> str:
        """The finding as one sentence, *where: found X, expected Y*, and its consequence."""
        where = self.path
        if self.attribute:
            where += (" " if " " in self.attribute else ".") + self.attribute
        if self.time is not None:
            where += f" at {self.time:g}"
        if self.samples > 1:
            where += f" (and {counted(self.samples - 1, 'more sample')})"
        then = CODES[self.code].consequence
        sentence = f"{where}: found {self.found}, expected {self.expected}"
        return f"{sentence}; {then}" if then else sentence

    @property
    def told(self) -> str:
        """The line that commands print: severity, code and sentence."""
        return f"{self.severity} [{self.code}] {self.message}"

    @property
    def key(self) -> tuple[str, ...]:
        """Key that is equal for findings to be reported once."""
        if CODES[self.code].is_once:
            return self.file, self.code
        return self.file, self.code, self.path, self.attribute, self.found


def finding(
    code: str,
    where: str,
    found: str,
    expected: str,
    *,
    attribute: str | None = None,
    severity: Severity | None = None,
    cure: str = "",
) -> Finding:
    """Return a finding with the severity and the cure of its code, unless others are given.

    Args:
        code: Key of `CODES`.
        where: Path of a prim, or of one of its properties; or the name of something else.
        found, expected: As in the errors of `core.errors`.
        attribute: Attribute concerned, "" for none; `where` is then a path or a name as a whole.
            None for the one that `where` ends in, if it is the path of a property and not the
            name of a file with a usual suffix.
        severity, cure: None and "" for those of the code.
    """
    path = where
    if attribute is None:
        match = _PROPERTY.fullmatch(where)
        is_property = match is not None and not _FILE.fullmatch(match[2])
        path, attribute = match.groups() if match and is_property else (where, "")
    return Finding(
        code=code,
        severity=severity or CODES[code].severity,
        path=path,
        attribute=attribute,
        found=found,
        expected=expected,
        cure=cure or CODES[code].cure,
    )


def from_error(code: str, error: UsdSplatError, *, severity: Severity | None = None) -> Finding:
    """Return an error as a finding; one about a file names no attribute."""
    attribute = "" if isinstance(error, FormatError | UnknownFormatError | OutputError) else None
    return finding(
        code, error.where, error.found, error.expected, attribute=attribute, severity=severity
    )


class Findings:
    """Collector of the findings of a command; each is kept once, in the order of arrival.

    Args:
        listener: Called for each finding that is new.
        say: Called with messages that are no findings, such as the size of a file.
        is_strict: Whether `check` raises an error.
    """

    def __init__(
        self,
        listener: Callable[[Finding], None] = lambda finding: None,
        *,
        say: Callable[[str], None] = lambda text: None,
        is_strict: bool = False,
    ) -> None:
        self._found: dict[tuple[str, ...], Finding] = {}
        self._listener = listener
        self.say = say
        """Pass on a message that is no finding."""
        self.is_strict = is_strict
        """Whether nothing may be written if there is an error or a warning."""

    def add(self, found: Finding, *, time: float | None = None) -> None:
        """Add a finding, unless it is known.

        Args:
            found: The finding.
            time: Time code at which it was found; None for the first.
        """
        if found.key in self._found:
            return
        if time is not None and found.time is None:
            found = replace(found, time=time)
        self._found[found.key] = found
        self._listener(found)

    def extend(self, found: Iterable[Finding], *, time: float | None = None) -> None:
        """Add several findings, see `add`."""
        for each in found:
            self.add(each, time=time)

    def check(self) -> None:
        """Raise an error if the command is strict and may not go on.

        Raises:
            StrictError: If there is an error or a warning.
        """
        if self.is_strict and self.is_failure:
            counts = [(severity, self.count(severity)) for severity in STRICT]
            listed = " and ".join(counted(number, name) for name, number in counts if number)
            raise StrictError("--strict", listed, "none; nothing is written")

    @property
    def is_failure(self) -> bool:
        """Whether there is an error or a warning."""
        return any(each.severity in STRICT for each in self)

    def count(self, severity: Severity) -> int:
        """Return the number of findings of a severity."""
        return sum(each.severity == severity for each in self)

    def __iter__(self) -> Iterator[Finding]:
        return iter(self._found.values())

    def __len__(self) -> int:
        return len(self._found)
