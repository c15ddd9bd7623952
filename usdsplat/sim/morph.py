"""Morph a capture into another one: both move together along one transport map.

The splats of the capture travel to the other one and fade out when they are there; those of the
other one travel from the capture to their own places and fade in on the way. Colours go from one to
the other. In the end only the other capture is left, as it was captured.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.core.progress import phase
from usdsplat.kernels.device import Device
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.carrying import Carrying, read
from usdsplat.sim.conform import Rows
from usdsplat.sim.conform_transport import MOST, TransportConform, below
from usdsplat.sim.flying import ramp
from usdsplat.sim.grounds import SheetGround, frame_triangle
from usdsplat.sim.parameters import ConformParameters
from usdsplat.sim.sheets import Sheet, outer_sheet
from usdsplat.sim.specs import Moment, Surface
from usdsplat.sim.state import Frame
from usdsplat.sim.target_mesh import TargetMesh
from usdsplat.sim.transport_map import TransportMap, match

APPEARS, VANISHES = (0.3, 0.5), (0.5, 0.7)
"""Progress between which the splats of the other capture fade in, and those of the capture out: on
the way, where both look alike."""
RECOLORED = (0.4, 0.9)
"""Progress between which the colours of the capture become those of the other one."""
_ROWS = ("natives", "tints")
_BACK = "back:"


class Morph(TransportConform):
    """Binding of the splats of two captures to each other.

    Args:
        device: Runs the kernels.
        rest: The capture at rest.
        carriers: Its carriers.
        becomes: The other capture, in the same space.
        ids, select: See `TransportConform`.
        first: Values of the stage at the first frame.
    """

    def __init__(
        self,
        device: Device,
        rest: SplatCloud,
        carriers: Carriers,
        becomes: SplatCloud,
        *,
        ids: I64,
        select: F32,
        first: Moment,
    ) -> None:
        super().__init__(
            device, rest, carriers, ids=ids, select=select, order=first.order, up=first.up,
            parameters=first.parameters,
        )  # fmt: skip
        self._becomes = becomes
        self._frames = _frames(rest.positions, becomes.positions)
        self._back: Carrying | None = None
        self._natives = np.zeros(len(select), np.bool_)
        self._tints = np.zeros((len(select), 3), np.float32)
        self._way = np.zeros(len(select), np.float32)

    # --- births, deaths, restarts -------------------------------------------------------

    def is_due(self, now: float, parameters: ConformParameters) -> bool:
        """Return whether the splats of the other capture must join now."""
        return parameters.weight > 0 and now > parameters.start and not self._natives.any()

    def joined(self) -> Morph:
        """Return a copy with the splats of the other capture appended."""
        other, cloud, device = self._copy(), self._becomes, self._device
        mesh = TargetMesh(device, self._frames)
        if other._carrying is None:
            other._bind(mesh)
        there, back = other._carrying, other._back
        assert there is not None and back is not None
        m = len(cloud)
        ground = self._ground(mesh, 1, Sheet.of(device, back.images, back.image_normals))
        landing = back.landing(ground, cloud.positions)
        bound = back.land(landing, cloud.rotations, cloud.scales)
        rows = np.concatenate([np.arange(len(self)), np.zeros(m, np.int64)])
        other._bound = other._bound.selected(rows).joined(bound)
        other._select = np.concatenate([other._select, np.ones(m, np.float32)])
        other._part = np.concatenate([other._part, np.zeros(m, np.float32)])
        other._way = np.concatenate([other._way, np.zeros(m, np.float32)])
        ranks = back.ranks(landing)
        if self._parameters.conform.order == "random" and self._order is None:
            ranks = self._drawn(-1 - np.arange(m, dtype=np.int64))
        other._ranks = np.concatenate([other._ranks, ranks])
        other._natives = np.concatenate([other._natives, np.ones(m, np.bool_)])
        tints = read(there.colors, landing)
        other._tints = np.concatenate([other._tints, tints])
        return other

    def extended(
        self, parents: Rows, positions: F32, rotations: F32, scales: F32, ids: I64
    ) -> Morph:
        """Return a copy with children appended, which are bound like their parents."""
        return self.selected(np.concatenate([np.arange(len(self)), parents]))

    def selected(self, rows: Rows) -> Morph:
        """Return a copy with these rows only, in this order."""
        other = self._copy()
        other._select_rows(rows)
        other._natives, other._tints = self._natives[rows], self._tints[rows]
        other._way = self._way[rows]
        return other

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return the binding of the splats and both maps."""
        kept = super().memory()
        if self._back is None:
            return kept
        kept |= {"natives": self._natives, "tints": self._tints}
        return kept | {f"{_BACK}{name}": each for name, each in self._back.arrays().items()}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, for any number of splats, bit for bit."""
        super().restore(memory)
        self._way = np.zeros(len(self), np.float32)
        if "natives" not in memory:
            return
        self._natives, self._tints = memory["natives"], memory["tints"]
        self._back = Carrying.of(self._device, below(memory, _BACK))

    # --- one step -----------------------------------------------------------------------

    @property
    def joining(self) -> SplatCloud:
        """The other capture."""
        return self._becomes

    def reset(self, rest: F32, positions: F32, gradient: F32 | None) -> None:
        """Undo deformations of the splats of the other capture.

        Args:
            rest: Positions at rest, shape (n, 3).
            positions, gradient: Deformed ones, changed in place.
        """
        if not self._natives.any():
            return
        positions[self._natives] = rest[self._natives]
        if gradient is not None:
            gradient[self._natives] = np.eye(3, dtype=np.float32)

    def apply(
        self,
        target: Surface | None,
        now: float,
        parameters: ConformParameters,
        positions: F32,
        gradient: F32 | None = None,
        factor: F32 | None = None,
    ) -> None:
        """Move the splats of both captures, see `TransportConform.apply`. The target is not
        used."""
        super().apply(self._frames, now, parameters, positions, gradient, factor)

    def opacity(self) -> F32 | None:
        """Return factors of the opacities at the time of the last `apply`, shape (n,)."""
        if not self._natives.any():
            return None
        come, go = ramp(self._way, *APPEARS), 1 - ramp(self._way, *VANISHES)
        return np.where(self._natives, come, go).astype(np.float32)

    def finished(self, frame: Frame) -> Frame:
        """Return a frame with the look of splats in flight, and colours between both captures."""
        frame = super().finished(frame)
        if not self._natives.any():
            return frame
        to = ramp(self._way, *RECOLORED)
        part = np.where(self._natives, 1 - to, to).astype(np.float32)
        sh = frame.cloud.sh * (1 - part[:, None, None])
        sh[:, 0] += part[:, None] * self._tints
        return replace(frame, cloud=replace(frame.cloud, sh=sh))

    def _progress(self, now: float, parameters: ConformParameters, factor: F32 | None) -> F32:
        """Return the way that splats are from their places at rest."""
        way = super()._progress(now, parameters, factor)
        self._way = way
        return np.where(self._natives, 1 - way, way)

    def _bind(self, mesh: TargetMesh) -> None:
        """Map the carriers of both captures onto each other, and bind the capture's splats."""
        device, cloud = self._device, self._becomes
        rest = self._moving
        sheet = self._thinned(outer_sheet(device, self._carriers, rest))
        most = self._parameters.carriers.count
        seed = self._parameters.sim.seed
        others = Carriers.of(device, cloud, seed=seed, most=most, up=self._up)
        goal = self._thinned(outer_sheet(device, others, cloud))
        ground = self._ground(mesh, 0, goal)
        with phase("transport", work=len(sheet)):
            found = match(device, sheet, ground.goal)
        carrying, landing = Carrying.along(device, found, ground, rest, down=self._down)
        inverse = TransportMap(
            source=Sheet.of(device, found.images, found.ups),
            images=sheet.positions,
            ups=sheet.normals,
            spacing=sheet.spacing,
        )
        back, _ = Carrying.along(device, inverse, self._ground(mesh, 1, sheet), cloud)
        carrying = self._finish(carrying, landing, mesh)
        self._back = replace(back, bows=carrying.bows, order=carrying.order)
        there = goal.bind(device, found.images)
        ends = np.einsum("nk,nki->ni", there.weights, goal.colors(device, cloud)[there.near])
        self._tints = read(ends.astype(np.float32), landing)

    def _ground(self, mesh: TargetMesh, face: int, sheet: Sheet) -> SheetGround:
        keep = self._parameters.conform.keep_thickness
        return SheetGround(self._device, sheet, mesh, face, keep)

    def _thinned(self, sheet: Sheet) -> Sheet:
        rows = sheet.thinned(self._device, MOST)
        return sheet if len(rows) == len(sheet) else sheet.selected(self._device, rows)


def _frames(first: F32, second: F32) -> Surface:
    """Return a triangle around the second points, and one around the first."""
    there, here = frame_triangle(second), frame_triangle(first)
    return Surface(
        points=np.concatenate([there.points, here.points]),
        triangles=np.concatenate([there.triangles, here.triangles + 3]).astype(np.int32),
    )
