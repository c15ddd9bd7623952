"""Guess the up direction of a capture from its splats.

There are two cues. A scene is widest at its foot, because the ground is there. And floors and
tables consist of flat splats that face up or down, most of them below the middle. Neither is proof:
both fail for objects that hang from a ceiling. So the guess comes with its evidence, and there is
no guess if directions score alike. `axes_choice` uses it if a file does not state its axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core import axes, quaternion
from usdsplat.core.cloud import F64, SplatCloud

FRAMES = {"-y": "rdf", "+y": "rub", "+z": "rfu"}
"""Up direction -> the common axes with this direction."""

_MOST = 100_000
"""Maximum number of splats that are used."""
_LEAST = 200
_INSIDE = (1.0, 99.0)
"""Percentiles that bound the box used: floaters lie outside."""
_END = 0.15
"""Fraction of the height that counts as an end."""
_WIDEST = 0.75
"""Minimum width of the foot, as a fraction of the widest part."""
_SLICES = 7
_FLAT = 0.5
"""Maximum ratio of shortest to middle scale of a splat that counts as flat."""
_FACING = math.cos(math.radians(20))
_CONVINCING, _AHEAD = math.log(2), 1.3
"""Minimum score of a direction, and minimum ratio to the next: with these, no test capture with
known axes is guessed wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameGuess:
    """A guess of a capture's axes, with evidence."""

    assumed: str
    """Axes that are assumed, from the format or the user."""
    up: str | None
    """Apparent up direction, such as "-y"; None if unclear."""
    suggested: str | None
    """Common axes with this up direction; None if unclear."""
    evidence: tuple[str, ...]
    """Evidence, one sentence each."""
    score: float = 0.0
    """Score of the best direction; 0 is no evidence."""

    @property
    def agrees(self) -> bool | None:
        """Whether the assumed axes have the same up direction; None if unclear."""
        return None if self.up is None else up_of(self.assumed) == self.up


def up_of(frame: str) -> str:
    """Return the up direction of axes, such as "-y" for "rdf".

    Raises:
        UsageError: If there is no such frame.
    """
    up = axes.frame_matrix(frame).T @ (0.0, 1.0, 0.0)
    axis = int(np.argmax(np.abs(up)))
    return ("+" if up[axis] > 0 else "-") + "xyz"[axis]


def guess_frame(cloud: SplatCloud, assumed: str) -> FrameGuess:
    """Guess the axes from the positions of splats and the orientation of flat ones.

    Args:
        cloud: Splats in the capture's own axes; those with a number that is not finite are ignored.
        assumed: Axes that are assumed.

    Raises:
        UsageError: If there is no such frame.
    """
    up_of(assumed)
    splats = _Splats.of(cloud)
    if len(splats.places) < _LEAST:
        few = f"{len(splats.places)} splats are too few to tell"
        return FrameGuess(assumed=assumed, up=None, suggested=None, evidence=(few,))
    scores = {}
    for up in FRAMES:
        axis, sign = "xyz".index(up[1]), 1 if up[0] == "+" else -1
        height = splats.places[:, axis] if sign > 0 else 1 - splats.places[:, axis]
        scores[up] = _Score.of(splats, axis, height)
    best, second = sorted(scores, key=lambda up: scores[up].total, reverse=True)[:2]
    score = scores[best].total
    clear = score >= max(_CONVINCING, _AHEAD * scores[second].total)
    if not clear:
        tie = f"no direction is clearly best: {best} is slightly ahead of {second}"
        return FrameGuess(assumed=assumed, up=None, suggested=None, evidence=(tie,), score=score)
    return FrameGuess(
        assumed=assumed,
        up=best,
        suggested=FRAMES[best],
        evidence=scores[best].said(best),
        score=score,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Splats:
    """A subset of a capture's splats, without outliers."""

    places: F64
    """Centres in the box, 0 to 1 on each axis, shape (n, 3)."""
    positions: F64
    """Centres [scene unit], shape (n, 3)."""
    faces: F64
    """Normals of flat splats, 0 for others, shape (n, 3)."""
    weights: F64
    """Visible size of each: area times opacity, shape (n,)."""

    @classmethod
    def of(cls, cloud: SplatCloud) -> _Splats:
        rows = slice(None, None, max(1, -(-len(cloud) // _MOST)))
        positions = cloud.positions[rows].astype(np.float64)
        scales = cloud.scales[rows].astype(np.float64)
        turns = cloud.rotations[rows].astype(np.float64)
        opacities = cloud.opacities[rows].astype(np.float64)
        columns = (positions, scales, turns, opacities[:, None])
        sound = np.isfinite(np.column_stack(columns)).all(axis=1)
        if not sound.any():
            empty = np.empty((0, 3))
            return cls(empty, empty, empty, np.empty(0))
        low, high = np.percentile(positions[sound], _INSIDE, axis=0)
        kept = sound & (positions >= low).all(axis=1) & (positions <= high).all(axis=1)
        positions, scales, turns, opacities = (
            array[kept] for array in (positions, scales, turns, opacities)
        )
        order = np.sort(scales, axis=1)
        weights = order[:, 1] * order[:, 2] * opacities
        if len(weights):  # limits the weight of a few backdrops
            weights = np.minimum(weights, np.percentile(weights, 99))
        matrices = quaternion.to_matrix(quaternion.normalize(turns))
        shortest = np.argmin(scales, axis=1)
        normals = np.take_along_axis(matrices, shortest[:, None, None], axis=2)[:, :, 0]
        is_flat = order[:, 0] < _FLAT * order[:, 1]
        extents = np.where(high > low, high - low, 1.0)
        faces = np.where(is_flat[:, None], normals, 0.0)
        return cls((positions - low) / extents, positions, faces, weights)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Score:
    """Evidence for one direction."""

    wider: float
    """Ratio of widths of foot and head; 1 if there is no foot."""
    facing: float
    """Fraction of the flat splats' area that faces along the axis [0..1]."""
    below: float
    """Mean position of this area along the axis, -1 at the head to 1 at the foot."""

    @classmethod
    def of(cls, splats: _Splats, axis: int, height: F64) -> _Score:
        across = np.delete(splats.positions, axis, axis=1)
        foot, head = (_spread(across[rows]) for rows in (height < _END, height > 1 - _END))
        slices = np.minimum((height * _SLICES).astype(int), _SLICES - 1)
        widest = max(_spread(across[slices == each]) for each in range(_SLICES))
        is_foot = head > 0 and foot > _WIDEST * widest
        has_face = splats.faces.any(axis=1)
        faces_along = np.abs(splats.faces[:, axis]) > _FACING
        total = splats.weights[has_face].sum()
        along = splats.weights[faces_along]
        mean = np.average(height[faces_along], weights=along) if along.sum() > 0 else 0.5
        return cls(
            wider=max(foot / head, 1.0) if is_foot else 1.0,
            facing=float(along.sum() / total) if total > 0 else 0.0,
            below=float(1 - 2 * mean),
        )

    @property
    def total(self) -> float:
        """Score: higher is more likely, 0 is no evidence."""
        return math.log(self.wider) + self.facing * self.below

    def said(self, up: str) -> tuple[str, ...]:
        """Describe the evidence in sentences."""
        evidence = [f"with {up} up, its bottom is {self.wider:.2g} times as wide as its top"]
        if self.facing * self.below > 0.05:
            evidence.append(
                f"{self.facing:.0%} of the area of flat splats is perpendicular to {up[1]}, "
                "mostly in the lower half"
            )
        return tuple(evidence)


def _spread(across: npt.NDArray[np.float64]) -> float:
    """Return the spread of splats around their mean [scene unit]; 0 for too few."""
    return float(np.sqrt(across.var(axis=0).sum())) if len(across) >= 8 else 0.0
