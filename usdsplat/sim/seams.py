"""Seams between the pieces of a capture, and splats that are cut at them.

A seam is a row of points on the surface, each with the normal of the broken face that goes down
from there. Splats that reach over a seam would be seen as smears between pieces that part: each is
cut back to the part of it that is on its own side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I64
from usdsplat.core.quaternion import from_matrix, to_matrix
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.carriers import Carriers

ACROSS = 1.7
"""Longest edge between carriers that crosses a seam, in distances of carriers."""
AROUND, EVEN = 12, 2.2
"""Points of a seam that its course is the mean of, and the width of their weights, in distances of
carriers: seams between carriers are jagged."""
ROUNDS = 2
"""Times that it is evened out."""
PARTED = 0.2
"""Change of the distance of carriers across a seam from which it has opened, in their distances."""
REACHES = 2.5
"""Distance to a seam, in standard deviations of a splat, up to which it is cut."""
CRISP = 2.0
"""Distance of a cut splat to its seam, in standard deviations, at least."""
LEAST = 0.002
"""Least standard deviation of a cut splat, in distances of carriers."""
BEYOND = 1.0
"""Distance beyond its seam, in standard deviations, from which a splat vanishes."""
BESIDE = 1.5
"""Distance along a seam, in distances of carriers, up to which a point stands for it; in addition
to the part of the splat that is cut."""
NEAR = 16
"""Points of seams among which the nearest ones of a splat's own piece are looked for."""

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Seams:
    """Points of all seams, s of them: each twice, once for either side."""

    carriers: I64
    """The carrier on this side, shape (s,)."""
    beyond: I64
    """The nearest carrier on the other side, shape (s,)."""
    own: I64
    """The piece on this side, shape (s,)."""
    other: I64
    """That beyond, shape (s,)."""
    positions: F32
    """[unit], shape (s, 3)."""
    normals: F32
    """Unit normals of the broken face, to the other side, shape (s, 3)."""

    @classmethod
    def of(cls, device: Device, carriers: Carriers, piece: npt.NDArray[np.int32]) -> Seams:
        """Return the seams between pieces.

        Args:
            device: Runs the kernels.
            carriers: Carriers of a field; those inside the capture have no seams.
            piece: Piece of each, shape (c,).
        """
        graph, places = carriers.graph, carriers.positions.astype(np.float64)
        first = np.repeat(np.arange(len(carriers)), np.diff(graph.rows))
        second = graph.neighbors.astype(np.int64)
        way = places[second] - places[first]
        kept = (piece[first] != piece[second]) & carriers.outer[first] & carriers.outer[second]
        kept &= np.linalg.norm(way, axis=1) <= ACROSS * carriers.spacing
        first, second, way = first[kept], second[kept], way[kept]
        count = int(piece.max(initial=-1)) + 1
        keys, row = np.unique(first * count + piece[second], return_inverse=True)
        order = np.lexsort((np.linalg.norm(way, axis=1), row))
        nearest_first = order[np.searchsorted(row[order], np.arange(len(keys)))]
        number = np.maximum(np.bincount(row, minlength=len(keys)), 1)[:, None]
        mean = np.stack([np.bincount(row, way[:, a], len(keys)) for a in range(3)], axis=1) / number
        carrier, other = np.divmod(keys, max(count, 1))
        up = carriers.normals[carrier].astype(np.float64)
        made = cls(
            carriers=carrier,
            beyond=second[nearest_first],
            own=piece[carrier].astype(np.int64),
            other=other,
            positions=_f32(places[carrier] + 0.5 * mean),
            normals=_unit(mean - up * np.einsum("ni,ni->n", mean, up)[:, None], up),
        )
        for _ in range(ROUNDS if len(made) else 0):
            made = made._evened(device, carriers)
        return made

    def __len__(self) -> int:
        return len(self.carriers)

    def _evened(self, device: Device, carriers: Carriers) -> Seams:
        """Return the seams with points on a local mean of their planes."""
        near, apart = nearest(device, self.positions, self.positions, AROUND)
        lower, upper = np.minimum(self.own, self.other), np.maximum(self.own, self.other)
        same = (near >= 0) & (lower[near] == lower[:, None]) & (upper[near] == upper[:, None])
        sign = np.where(self.own[near] == self.own[:, None], 1.0, -1.0)
        width = EVEN * carriers.spacing
        weight = np.where(same, np.exp(-np.square(np.where(same, apart, 0) / width)), 0)
        normals = self.normals.astype(np.float64)
        mean = np.einsum("nk,nki->ni", weight * sign, normals[near])
        up = carriers.normals[self.carriers].astype(np.float64)
        mean = _unit(mean - up * np.einsum("ni,ni->n", mean, up)[:, None], up).astype(np.float64)
        places = self.positions.astype(np.float64)
        beyond = np.einsum("nki,ni->nk", places[near] - places[:, None], mean)
        shift = (weight * beyond).sum(axis=1) / weight.sum(axis=1)
        return Seams(
            carriers=self.carriers, beyond=self.beyond, own=self.own, other=self.other,
            positions=_f32(places + shift[:, None] * mean), normals=_f32(mean),
        )  # fmt: skip

    def parted(self, rest: F32, now: F32, spacing: float) -> Bools:
        """Return where the two sides have moved apart, shape (s,).

        Args:
            rest, now: Positions of the carriers, shape (c, 3).
            spacing: Their distance [unit].
        """
        was, is_ = (each[self.carriers] - each[self.beyond] for each in (rest, now))
        lengths = (np.linalg.norm(each.astype(np.float64), axis=1) for each in (was, is_))
        before, after = lengths
        return np.asarray(np.abs(after - before) > PARTED * spacing)

    def cut(
        self,
        device: Device,
        open_: Bools,
        fresh: Bools,
        piece: npt.NDArray[np.int32],
        spacing: float,
        shapes: tuple[F32, F32, F32],
    ) -> tuple[I64, tuple[F32, F32, F32], Bools]:
        """Cut splats that reach over seams.

        Of each seam of its piece, only the point that is nearest to a splat cuts it, if that is
        open and about beside it: a point stands for a part of the seam, not for a plane without an
        end. Splats that no fresh point cuts are left out; the result for others is that of all
        open points, in whatever order these opened.

        Args:
            device: Runs the kernels.
            open_: Which points of seams cut, shape (s,).
            fresh: Those of them that have opened since the last time, shape (s,).
            piece: Piece of each splat, -1 for none, shape (n,).
            spacing: Distance of carriers [unit].
            shapes: Positions, rotations and scales as captured, shapes (n, 3), (n, 4), (n, 3).

        Returns:
            The rows of the splats that are cut, shape (m,); their new shapes: each is the mean and
            the covariance of the part on its own side, made thinner where it is still blurred; and
            which vanish, because hardly any part is there, shape (m,).
        """
        sides = np.zeros(max(int(piece.max(initial=-1)), int(self.own.max(initial=-1))) + 1, bool)
        sides[self.own[fresh]] = True
        rows = np.flatnonzero((piece >= 0) & sides[np.maximum(piece, 0)])
        if not fresh.any() or not len(rows):
            first, second, third = (each[:0] for each in shapes)
            return np.empty(0, np.int64), (first, second, third), np.zeros(0, np.bool_)
        near = self._nearest(device, piece[rows], shapes[0][rows])
        concerned = ((near >= 0) & fresh[near]).any(axis=1)
        rows, near = rows[concerned], near[concerned]
        captured, rotations, scales = (each[rows].astype(np.float64) for each in shapes)
        positions, wide = captured.copy(), scales.max(axis=1, initial=0)
        axes = to_matrix(rotations) * scales[:, None, :]
        spread = axes @ axes.transpose(0, 2, 1)
        changed, gone = (np.zeros(len(rows), np.bool_) for _ in range(2))
        again = changed.copy()
        for k in range(NEAR):
            some = np.flatnonzero((near[:, k] >= 0) & open_[near[:, k]])
            seam = near[some, k]
            normal = self.normals[seam].astype(np.float64)
            place = self.positions[seam].astype(np.float64)
            way = place - captured[some]
            way -= np.einsum("ni,ni->n", way, normal)[:, None] * normal
            aside = np.linalg.norm(way, axis=1)
            depth = np.einsum("ni,ni->n", place - positions[some], normal)
            along = np.einsum("nij,nj->ni", spread[some], normal)
            sigma = np.sqrt(np.maximum(np.einsum("ni,ni->n", along, normal), 1e-30))
            reach = depth < REACHES * sigma
            reach &= aside <= BESIDE * spacing + REACHES * wide[some]
            some, seam, normal, depth = some[reach], seam[reach], normal[reach], depth[reach]
            along, sigma = along[reach], sigma[reach]
            gone[some[depth < -BEYOND * sigma]] = True
            shift, narrow = _halved(depth / sigma)
            across = along / sigma[:, None]
            positions[some] -= shift[:, None] * across
            depth = depth + shift * sigma
            narrow = np.minimum(narrow, np.square(depth / (CRISP * sigma)))
            spread[some] -= (1 - narrow)[:, None, None] * across[:, :, None] * across[:, None, :]
            changed[some] = True
            again[some] |= fresh[seam]
        changed &= again
        rows = rows[changed]
        values, vectors = np.linalg.eigh(spread[changed])
        vectors[:, :, 0] *= np.sign(np.linalg.det(vectors))[:, None]
        sizes = np.sqrt(np.maximum(values, np.square(LEAST * spacing)))
        made = _f32(positions[changed]), _f32(from_matrix(vectors)), _f32(sizes)
        return rows, made, gone[changed]

    def _nearest(self, device: Device, piece: npt.NDArray[np.int32], places: F32) -> I64:
        """Return the nearest point of each seam of its own piece for every splat, nearest first;
        -1 for none, shape (n, NEAR)."""
        near = nearest(device, self.positions, places, NEAR)[0].astype(np.int64)
        near[(near >= 0) & (self.own[near] != piece[:, None])] = -1
        others = np.where(near >= 0, self.other[near], -1)
        for k in range(1, NEAR):
            near[(others[:, :k] == others[:, k : k + 1]).any(axis=1), k] = -1
        return near


def _halved(edge: F64) -> tuple[F64, F64]:
    """Return how far the mean of a normal distribution moves that is cut off above `edge`, and the
    variance that is left; both relative to the whole, as is the edge, shape (n,).

    Source: Johnson, Kotz & Balakrishnan 1994, section 13.10.
    """
    a = np.maximum(edge, -4.0)
    density = np.exp(-0.5 * a * a) / np.sqrt(2 * np.pi)
    ratio = density / np.maximum(_below(a), 1e-12)
    return ratio + np.maximum(a - edge, 0), np.clip(1 - a * ratio - ratio * ratio, 1e-3, 1)


def _below(a: F64) -> F64:
    """Return the normal distribution, to 1e-7 of its value.

    Source: Abramowitz & Stegun 1964, 7.1.26, of the complementary error function.
    """
    t = 1 / (1 + 0.3275911 * np.abs(a) / np.sqrt(2))
    series = t * (
        0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))
    )
    tail = 0.5 * series * np.exp(-0.5 * a * a)
    return np.asarray(np.where(a < 0, tail, 1 - tail))


def _unit(vectors: F64, up: F64) -> F32:
    """Return unit vectors; where there is no direction, any one across `up`."""
    aside = np.where(np.abs(up[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    aside = np.cross(up, aside)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    found = np.where(length > 1e-12, vectors / np.maximum(length, 1e-30), aside)
    return _f32(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30))


def _f32(values: npt.NDArray[np.floating]) -> F32:
    return np.ascontiguousarray(values, np.float32)
