"""The value of a code of findings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True)
class Code:
    """Meaning of a code."""

    severity: Severity
    """Usual severity."""
    meaning: str
    """What was found, as one sentence without a full stop."""
    cure: str
    """Usual cure, unless a finding has a better one."""
    consequence: str = ""
    """What the command does instead. It ends the sentence of each finding; "" adds nothing."""
    is_once: bool = False
    """Whether a file has the finding once, at the first place where it was found."""
