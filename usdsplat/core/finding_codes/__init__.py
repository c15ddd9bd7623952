"""The codes of findings: severity, meaning and cure of each."""

from __future__ import annotations

from usdsplat.core.finding_codes import fields, products, stages
from usdsplat.core.finding_codes.code import Code, Severity

__all__ = ["CODES", "LIBRARY_MESSAGES", "Code", "Severity"]

LIBRARY_MESSAGES = ("usd-message", "python-warning")
"""Codes of messages of libraries, which commands print with --verbose only."""

CODES: dict[str, Code] = {**stages.CODES, **products.CODES, **fields.CODES}
"""Code -> its meaning. Codes of validation are also names of UsdValidation errors, in camelCase."""
