"""Weighted sums of rows: what one step of refinement does to values, whatever they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32

_CHUNK = 1 << 14  # rows at a time: temporaries stay in the cache


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Block:
    """Rows that are sums of equally many terms."""

    rows: I32
    """Which rows of the result, shape (m,)."""
    columns: I32
    """Which row of the values each term is, shape (w, m)."""
    weights: F32
    """What it is multiplied by, shape (w, m), or (w, 1) when that is the same in all rows."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Stencil:
    """A sparse matrix by blocks of rows; each row has weights that add up to one."""

    size: int
    """Rows of the result."""
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
    """One refinement of values: points stay first, then those on edges, then those on faces."""

    means: Stencil | None
    """Points on faces; None where a scheme has none."""
    others: Stencil
    """Points of vertices and edges, from the values followed by those on faces."""

    def apply(self, values: F32) -> F32:
        """Values of the finer level, shape (m, k)."""
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
    """Take values, shape (n, k), through all steps."""
    width = values.shape[1]
    if width == 3 and steps:  # rows of 16 bytes are fetched twice as fast as those of 12
        padded = np.zeros((len(values), 4), np.float32)
        padded[:, :3] = values
        values = padded
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # what is not finite spoils its own surrounds
        for step in steps:
            values = step.apply(values)
    return np.ascontiguousarray(values[:, :width])
