"""Findings of validation, and the samples that they are about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat.core.cloud import F32
from usdsplat.core.sh import coefficient_count
from usdsplat.core.wording import counted
from usdsplat.schema import attributes, stock, tokens
from usdsplat.schema.field import is_packed
from usdsplat.schema.validation.published import broken_rule
from usdsplat.schema.validation.value_types import fits
from usdsplat.schema.vt import as_float32

Severity = Literal["error", "warning"]


COMPARED = {"tooShort", "tooLong", "coefficientCount", "packedCount", "extentTooSmall"}
"""Findings that also depend on other attributes, and therefore on their sample times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A problem of a splat field, with its cure."""

    severity: Severity
    """An error changes the picture or prevents it; a warning may be a problem in other
    applications."""
    path: str
    """Path of the prim."""
    attribute: str
    """Attribute concerned; "" for the prim as a whole."""
    name: str
    """Identifier of the kind of finding, shared by all findings with the same cure."""
    found: str
    expected: str
    cure: str
    time: float | None = None
    """Time code of the first affected sample; None for a value that does not change."""
    samples: int = 1
    """Number of affected samples."""
    rule: str = ""
    """Published rule that it violates, see `published`; "" for none."""

    @property
    def message(self) -> str:
        """The finding as one sentence, *where: found X, expected Y*."""
        where = f"{self.path}.{self.attribute}" if self.attribute else self.path
        if self.time is not None:
            where += f" at {self.time:g}"
        if self.samples > 1:
            where += f" (and {counted(self.samples - 1, 'more sample')})"
        return f"{where}: found {self.found}, expected {self.expected}"


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A field at one time, as authored, before the rules about lengths apply."""

    prim: Usd.Prim
    code: Usd.TimeCode

    @property
    def is_packed(self) -> bool:
        """Whether the prim is of our packed type."""
        return is_packed(self.prim)

    def name(self, attribute: str) -> str:
        """Return the attribute that applies: the half variant of a stock one if only that is
        authored."""
        if self.is_packed or attribute not in tokens.HALF_OF:
            return attribute
        source = self.prim.GetAttribute(stock.source_name(self.prim, attribute))
        return str(source.GetName()) if source and source.HasAuthoredValue() else attribute

    def value(self, name: str) -> Any:
        """Return the value of an attribute, whether it applies or not, or None."""
        attribute = self.prim.GetAttribute(name) if name else None
        return attribute.Get(self.code) if attribute else None

    def is_typed(self, name: str) -> bool:
        """Return whether the attribute has the schema's type, or no value."""
        return fits(name, self.value(name))

    def array(self, attribute: str) -> npt.NDArray[Any] | None:
        """Return the value of the attribute that applies, or None if it has the wrong type or no
        value."""
        name = self.name(attribute)
        return attributes.array(self.prim, name, self.code) if self.is_typed(name) else None

    def numbers(self, attribute: str) -> F32:
        """Return `array` in float32, empty without a value."""
        values = self.array(attribute)
        return np.empty(0, np.float32) if values is None else as_float32(values)

    @property
    def count(self) -> int:
        """Number of splats."""
        values = self.array(tokens.POSITIONS)
        return 0 if values is None else len(values)

    @property
    def degree(self) -> int:
        """Authored degree of the harmonics; -1 if it is not an integer."""
        is_number = self.is_typed(tokens.SH_DEGREE)
        return attributes.degree(self.prim, self.code) if is_number else -1

    @property
    def coefficients(self) -> int:
        """Number of coefficients per splat at that degree, at least one."""
        return coefficient_count(max(self.degree, 0))

    def finding(
        self, severity: Severity, attribute: str, name: str, found: str, expected: str, cure: str
    ) -> Finding:
        """Return a finding about this sample."""
        names = {attribute} if attribute else set()
        if name in COMPARED:
            names |= tokens.DATA_ATTRIBUTES
        varies = bool(attributes.sample_times(self.prim, names))
        return Finding(
            severity=severity,
            path=str(self.prim.GetPath()),
            attribute=attribute,
            name=name,
            found=found,
            expected=expected,
            cure=cure,
            time=self.code.GetValue() if varies and self.code.IsNumeric() else None,
            rule=broken_rule(str(self.prim.GetTypeName()), attribute, name),
        )
