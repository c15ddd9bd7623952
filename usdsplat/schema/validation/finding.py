"""What validation says about a field, and what it looks at to say it."""

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
"""Names of findings that depend on other attributes as well, and so on those attributes' times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Something wrong with a splat field, and what to do about it."""

    severity: Severity
    """An error changes or loses the picture; a warning is what other applications may trip over."""
    path: str
    """The prim."""
    attribute: str
    """The attribute it is about; "" for the prim as a whole."""
    name: str
    """What is wrong, one word of several: the same for all findings with the same cure."""
    found: str
    expected: str
    cure: str
    time: float | None = None
    """Time code of the first sample that has it; None for a value that does not change."""
    samples: int = 1
    """How many samples have it."""
    rule: str = ""
    """The published rule that it breaks, see `published`; "" for none."""

    @property
    def message(self) -> str:
        """One sentence, *where: found X, expected Y*."""
        where = f"{self.path}.{self.attribute}" if self.attribute else self.path
        if self.time is not None:
            where += f" at {self.time:g}"
        if self.samples > 1:
            where += f" (and {counted(self.samples - 1, 'more sample')})"
        return f"{where}: found {self.found}, expected {self.expected}"


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One field at one time, as it is written: no rule about lengths has been applied."""

    prim: Usd.Prim
    code: Usd.TimeCode

    @property
    def is_packed(self) -> bool:
        """Whether the prim is of our compact type."""
        return is_packed(self.prim)

    def name(self, attribute: str) -> str:
        """The attribute that counts: the half twin of a stock one where only that has a value."""
        if self.is_packed or attribute not in tokens.HALF_OF:
            return attribute
        source = self.prim.GetAttribute(stock.source_name(self.prim, attribute))
        return str(source.GetName()) if source and source.HasAuthoredValue() else attribute

    def value(self, name: str) -> Any:
        """The value of an attribute, whether it counts or not; None when there is none."""
        attribute = self.prim.GetAttribute(name) if name else None
        return attribute.Get(self.code) if attribute else None

    def is_typed(self, name: str) -> bool:
        """Whether the attribute has the type that the schema says, or no value at all."""
        return fits(name, self.value(name))

    def array(self, attribute: str) -> npt.NDArray[Any] | None:
        """The value of the attribute that counts; None when there is none of the right type."""
        name = self.name(attribute)
        return attributes.array(self.prim, name, self.code) if self.is_typed(name) else None

    def numbers(self, attribute: str) -> F32:
        """The same in float32, without rows where there is none."""
        values = self.array(attribute)
        return np.empty(0, np.float32) if values is None else as_float32(values)

    @property
    def count(self) -> int:
        """Number of splats."""
        values = self.array(tokens.POSITIONS)
        return 0 if values is None else len(values)

    @property
    def degree(self) -> int:
        """Degree of the harmonics as written; -1 where that is no whole number."""
        is_number = self.is_typed(tokens.SH_DEGREE)
        return attributes.degree(self.prim, self.code) if is_number else -1

    @property
    def coefficients(self) -> int:
        """Coefficients of a splat at that degree, at least one."""
        return coefficient_count(max(self.degree, 0))

    def finding(
        self, severity: Severity, attribute: str, name: str, found: str, expected: str, cure: str
    ) -> Finding:
        """A finding about this sample."""
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
