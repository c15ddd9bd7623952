"""Apply a refinement step to values: weighted sums of rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32

_CHUNK = 1 << 14  # rows per block: temporaries stay in the cache


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Block:
    """Rows that are sums of equally many terms."""

    rows: I32
    """Row of the result for each sum, shape (m,)."""
    columns: I32
    """Row of the values of each term, shape (w, m)."""
    weights: F32
    """Factors of the terms, shape (w, m), or (w, 1) if equal in all rows."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Stencil:
    """A sparse matrix in blocks of rows; the weights of a row add up to one."""

    size: int
    """Number of rows of the result."""
    blocks: tuple[Block, ...]

    def into(self, values: F32, out: F32) -> None:
        """Write the sums of the rows of `values`, shape (n, k), to `out`, shape (size, k)."""
        for block in self.blocks:
            for first in range(0, len(block.rows), _CHUNK):
                part = slice(first, first + _CHUNK)
                weights = block.weights if block.weights.shape[1] == 1 else block.weights[:, part]
                total = np.take(values, block.columns[0, part], axis=0)
                total *= weights[0][:, None]
                for column, weight in zip(block.columns[1:, part], weights[1:], strict=True):
                    term = np.take(values, column, axis=0)
                    term *= weight[:, None]
                    total += term
                out[block.rows[part]] = total


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Step:
    """A refinement of values: vertex points first, then edge points, then face points."""

    means: Stencil | None
    """Face points; None if the scheme has none."""
    others: Stencil
    """Vertex and edge points, computed from the values followed by the face points."""

    def apply(self, values: F32) -> F32:
        """Return the values of the finer level, shape (m, k)."""
        width = values.shape[1]
        if self.means is None:
            fine = np.empty((self.others.size, width), np.float32)
            self.others.into(values, fine)
            return fine
        both = np.empty((len(values) + self.means.size, width), np.float32)
        both[: len(values)] = values
        self.means.into(values, both[len(values) :])
        fine = np.empty((self.others.size + self.means.size, width), np.float32)
        fine[self.others.size :] = both[len(values) :]
        self.others.into(both, fine[: self.others.size])
        return fine


def refine(steps: tuple[Step, ...], values: F32) -> F32:
    """Apply all steps to values, shape (n, k)."""
    width = values.shape[1]
    if width == 3 and steps:  # rows of 16 bytes load twice as fast as 12
        padded = np.zeros((len(values), 4), np.float32)
        padded[:, :3] = values
        values = padded
    with np.errstate(over="ignore", invalid="ignore"):  # NaN spreads to neighbours only
        for step in steps:
            values = step.apply(values)
    return np.ascontiguousarray(values[:, :width])
