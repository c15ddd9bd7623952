"""Samples of fields that validation checks, and findings about them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat.core.cloud import F32
from usdsplat.core.findings import Finding, Severity
from usdsplat.core.sh import coefficient_count
from usdsplat.schema import attributes, stock, tokens
from usdsplat.schema.field import is_packed
from usdsplat.schema.validation.published import broken_rule
from usdsplat.schema.validation.value_types import fits
from usdsplat.schema.vt import as_float32

COMPARED = {"too-short", "too-long", "coefficient-count", "packed-count", "extent-too-small"}
"""Findings that also depend on other attributes, and therefore on their sample times."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A field at one time, as authored, before the rules about lengths apply."""

    prim: Usd.Prim
    code: Usd.TimeCode
    _values: dict[str, Any] = field(init=False, default_factory=dict)
    """Values that were read, because several checks need each."""

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
        if name not in self._values:
            attribute = self.prim.GetAttribute(name) if name else None
            self._values[name] = attribute.Get(self.code) if attribute else None
        return self._values[name]

    def is_typed(self, name: str) -> bool:
        """Return whether the attribute has the schema's type, or no value."""
        return fits(name, self.value(name))

    def array(self, attribute: str) -> npt.NDArray[Any] | None:
        """Return the value of the attribute that applies, or None if it has the wrong type or no
        value."""
        name = self.name(attribute)
        return attributes.as_array(self.value(name)) if self.is_typed(name) else None

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
        self, severity: Severity, attribute: str, code: str, found: str, expected: str, cure: str
    ) -> Finding:
        """Return a finding about this sample."""
        names = {attribute} if attribute else set()
        if code in COMPARED:
            names |= tokens.DATA_ATTRIBUTES
        varies = bool(attributes.sample_times(self.prim, names))
        return Finding(
            severity=severity,
            path=str(self.prim.GetPath()),
            attribute=attribute,
            code=code,
            found=found,
            expected=expected,
            cure=cure,
            time=self.code.GetValue() if varies and self.code.IsNumeric() else None,
            rule=broken_rule(str(self.prim.GetTypeName()), attribute, code),
        )
