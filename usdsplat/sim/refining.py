"""Refinement: divide splats that are too large for what happens to them.

One large splat has one colour and one shape, so it cannot show a cell of a pattern, bend, or let go
of a part. It is divided along its longest axis into children that together look like it, see
`split_table`; children that are still too long are divided again, along whichever axis is the
longest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import split as kernels
from usdsplat.sim.carriers import MOST, expected_spacing
from usdsplat.sim.parameters import Parameters
from usdsplat.sim.rows import largest
from usdsplat.sim.split_table import TABLE
from usdsplat.sim.uses import Uses

FAINT = 0.1
"""Opacity below which splats are not divided. They are no part of a surface, and their children
would lose what falls below the opacity that is drawn."""
SEEN = 1 / 255
"""Opacity below which a child is drawn nowhere."""
GROWTH = 4
"""Largest number of splats after refinement, relative to that before, if no budget is given."""
PASSES = 12
"""Largest number of times that children are divided again; four suffice for an axis of a thousand
limits."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shapes:
    """Splats without colours."""

    positions: F32
    """[unit], shape (n, 3)."""
    rotations: F32
    """Quaternions (w, x, y, z), shape (n, 4)."""
    scales: F32
    """[unit], shape (n, 3)."""
    opacities: F32
    """[0..1], shape (n,)."""

    @classmethod
    def of(cls, cloud: SplatCloud) -> Shapes:
        """Return those of a cloud."""
        return cls(
            positions=cloud.positions,
            rotations=cloud.rotations,
            scales=cloud.scales,
            opacities=cloud.opacities,
        )

    def __len__(self) -> int:
        return len(self.positions)

    def taken(self, rows: npt.NDArray[np.integer]) -> Shapes:
        """Return some rows."""
        return Shapes(
            positions=self.positions[rows],
            rotations=self.rotations[rows],
            scales=self.scales[rows],
            opacities=self.opacities[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Cuts:
    """How n splats are divided."""

    axes: I32
    """Longest axis, shape (n,)."""
    entries: I32
    """Entry of the table, negative for splats that stay, shape (n,)."""
    sizes: F32
    """Size of the children along the axis, in that of the splat, shape (n,)."""

    @classmethod
    def of(
        cls,
        device: Device,
        shapes: Shapes,
        *,
        limit: float,
        anisotropy: float = math.inf,
        faint: float = FAINT,
    ) -> Cuts:
        """Return how splats above a size are divided once. Splats that are not finite stay.

        Args:
            device: Runs the kernels.
            shapes: The splats.
            limit: Largest standard deviation [unit].
            anisotropy: Largest ratio of the longest axis to the middle one; splats that are shorter
                than a quarter of the limit may exceed it.
            faint: Opacity below which splats stay.
        """
        n = len(shapes)
        axes, entries = device.empty(n, np.int32), device.empty(n, np.int32)
        sizes = device.empty(n, np.float32)
        with np.errstate(over="ignore"):
            limits = np.float32(limit), np.float32(anisotropy), np.float32(faint)
        device.run(
            kernels.choose, device.upload(shapes.positions), device.upload(shapes.scales),
            device.upload(shapes.opacities), *limits, TABLE.sigmas, axes, entries, sizes,
        )  # fmt: skip
        return cls(axes, entries, sizes)

    @property
    def rows(self) -> I64:
        """Splats that are divided, ascending."""
        return np.flatnonzero(self.entries >= 0)

    def within(self, sizes: F32, room: int) -> Cuts:
        """Return the cuts of the largest splats that add at most `room` splats; of equal ones, the
        first."""
        rows = self.rows
        rows = rows[np.argsort(-sizes[rows], kind="stable")]
        more = np.cumsum(TABLE.counts[self.entries[rows]] - 1)
        entries = np.full_like(self.entries, kernels.KEEP)
        kept = rows[more <= room]
        entries[kept] = self.entries[kept]
        return replace(self, entries=entries)


def split(device: Device, shapes: Shapes, cuts: Cuts) -> tuple[Shapes, I64]:
    """Divide splats once.

    Args:
        device: Runs the kernels.
        shapes: n splats.
        cuts: How.

    Returns:
        The children, ordered by the row of their splat, then along its axis; and these rows.
    """
    divided = cuts.rows
    counts = TABLE.counts[cuts.entries[divided]]
    rows = np.repeat(divided, counts)
    m = len(rows)
    numbers = (np.arange(m) - np.repeat(np.cumsum(counts) - counts, counts)).astype(np.int32)
    positions, scales = device.empty((m, 3), np.float32), device.empty((m, 3), np.float32)
    opacities = device.empty(m, np.float32)
    device.run(
        kernels.divide, device.upload(rows), device.upload(numbers),
        (cuts.axes, cuts.entries, cuts.sizes),
        (TABLE.firsts, TABLE.sigmas, TABLE.opacities, TABLE.children),
        device.upload(shapes.positions), device.upload(shapes.rotations),
        device.upload(shapes.scales), device.upload(shapes.opacities), positions, scales, opacities,
    )  # fmt: skip
    made = Shapes(
        positions=positions, rotations=shapes.rotations[rows], scales=scales, opacities=opacities
    )
    return made, rows


def refined(
    device: Device,
    cloud: SplatCloud,
    *,
    limit: float,
    anisotropy: float = math.inf,
    faint: float = FAINT,
    budget: int | None = None,
) -> tuple[SplatCloud, I64]:
    """Divide splats until none is too long, the largest first.

    Children have the rotation, harmonics and velocity of their splat, and new ids. Those that are
    drawn nowhere are left out.

    Args:
        device: Runs the kernels.
        cloud: The splats. Their ids ascend, if they have some.
        limit: Largest standard deviation [unit], >= 0.
        anisotropy: See `Cuts.of`.
        faint: Opacity below which splats stay, at least SEEN; children are divided again down to
            SEEN.
        budget: Largest number of splats; None is GROWTH times as many as there are. If it does not
            suffice, `oversized` tells how many are left.

    Returns:
        The cloud: first the splats that stay, then all children by the row of their splat; and the
        row of the splat that each is or is a child of, shape (m,). The cloud itself if none is
        divided.
    """
    n = len(cloud)
    room = (GROWTH * n if budget is None else budget) - n
    shapes = Shapes.of(cloud)
    parents = np.arange(n, dtype=np.int64)
    done: list[tuple[Shapes, I64]] = []
    for number in range(PASSES):
        least = SEEN if number else max(faint, SEEN)
        cuts = Cuts.of(device, shapes, limit=limit, anisotropy=anisotropy, faint=least)
        cuts = cuts.within(largest(shapes.scales), room)
        if not len(cuts.rows):
            break
        left = np.flatnonzero(cuts.entries < 0)
        done.append((shapes.taken(left), parents[left]))
        shapes, rows = split(device, shapes, cuts)
        drawn = np.flatnonzero(shapes.opacities >= np.float32(SEEN))
        shapes, rows = shapes.taken(drawn), rows[drawn]
        parents = parents[rows]
        room -= len(rows) - len(cuts.rows)
    if not done:
        return cloud, parents
    return _joined(cloud, done[0], [*done[1:], (shapes, parents)])


def spacing_of(device: Device, cloud: SplatCloud, parameters: Parameters, uses: Uses) -> float:
    """Return the spacing of what acts on a field's splats: that of its carriers, as authored or as
    it would be; it is fine unless there is nothing but matter.

    Args:
        device: Runs the kernels.
        cloud: The capture at rest.
        parameters: Its simulation.
        uses: What this needs.

    Returns:
        [unit]; 0 if it cannot be told.
    """
    p = parameters
    if p.carriers.spacing > 0:
        return p.carriers.spacing
    if uses.reacts and p.rd.pattern_scale > 0:
        return p.rd.pattern_scale
    is_coarse = uses.coheres and not (uses.reacts or uses.dissolves or uses.deforms)
    most = p.carriers.count if is_coarse else MOST
    return expected_spacing(device, cloud, seed=p.sim.seed, most=most)


def oversized(
    device: Device,
    cloud: SplatCloud,
    *,
    limit: float,
    anisotropy: float = math.inf,
    faint: float = FAINT,
) -> int:
    """Return the number of splats that `refined` would divide with an unlimited budget."""
    shapes = Shapes.of(cloud)
    return len(Cuts.of(device, shapes, limit=limit, anisotropy=anisotropy, faint=faint).rows)


def _joined(
    cloud: SplatCloud, whole: tuple[Shapes, I64], parts: list[tuple[Shapes, I64]]
) -> tuple[SplatCloud, I64]:
    """Return the cloud of splats that stay and of all children, and their rows in `cloud`."""
    rows = np.concatenate([parents for _, parents in parts])
    order = np.argsort(rows, kind="stable")
    parents = np.concatenate([whole[1], rows[order]])

    def joined(name: str) -> F32:
        values = np.concatenate([getattr(shapes, name) for shapes, _ in parts])
        return np.concatenate([getattr(whole[0], name), values[order]])

    ids = np.arange(len(cloud), dtype=np.int64) if cloud.ids is None else cloud.ids
    first = int(ids.max(initial=-1)) + 1
    made = SplatCloud(
        positions=joined("positions"),
        rotations=cloud.rotations[parents],
        scales=joined("scales"),
        opacities=joined("opacities"),
        sh=cloud.sh.take(parents, axis=0),
        ids=np.concatenate([ids[whole[1]], np.arange(first, first + len(rows))]),
        velocities=None if cloud.velocities is None else cloud.velocities[parents],
    )
    return made, parents
