"""Target pose of each splat: the capture, deformed, skinned, and conformed to a target.

The deformation gradient of these steps is computed too; it rotates and stretches the splats.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.conform import Conform
from usdsplat.sim.conform_transport import TransportConform
from usdsplat.sim.deform import deform
from usdsplat.sim.limits import has_area
from usdsplat.sim.masks import Masks
from usdsplat.sim.morph import Morph
from usdsplat.sim.skin import Skin
from usdsplat.sim.specs import Deformer, Moment, Recipe
from usdsplat.sim.state import Frame, State


class TargetPose:
    """Target pose of the splats of one field over time.

    Args:
        device: Runs the kernels.
        recipe: The field.
        first: Values of the stage at the first frame.
        masks: The masks of the field.
        carriers: Carriers of the field; only a conform by transport needs them.
    """

    def __init__(
        self,
        device: Device,
        recipe: Recipe,
        first: Moment,
        masks: Masks,
        carriers: Carriers | None = None,
    ) -> None:
        self._device, self._masks = device, masks
        self._skin: Skin | None = None
        rest, p = recipe.rest, first.parameters
        if recipe.binding is not None:
            self._skin = Skin(device, recipe.binding, rest.positions, p.skin)
        self._conform: Conform | TransportConform | None = None
        if first.target is None and (first.becomes is None or carriers is None):
            return
        ids = np.arange(len(rest)) if rest.ids is None else rest.ids
        selected = recipe.selection
        select = np.ones(len(rest), np.float32) if selected is None else selected
        if carriers is not None and first.becomes is not None:
            self._conform = Morph(
                device, rest, carriers, first.becomes,
                ids=ids, select=select, first=first,
            )  # fmt: skip
        elif (
            carriers is not None
            and first.target is not None
            and p.conform.mode == "transport"
            and has_area(first.target)
        ):
            self._conform = TransportConform(
                device, rest, carriers, ids=ids, select=select, order=first.order, up=first.up,
                parameters=p,
            )  # fmt: skip
        else:
            self._conform = Conform(
                device,
                rest.positions,
                rest.rotations,
                rest.scales,
                ids=ids,
                select=select,
                parameters=p,
            )

    def stretched(self, moment: Moment) -> Moment:
        """Return a moment with the limit of stretches for the poses of its time. Transport limits
        the stretch of deformations by itself, and scales splats to the target beyond it."""
        if not isinstance(self._conform, TransportConform):
            return moment
        p = moment.parameters
        appearance = replace(p.appearance, max_stretch=math.inf)
        return replace(moment, parameters=replace(p, appearance=appearance))

    def at(
        self, state: State, moment: Moment, seconds: float, *, gradient: bool = False
    ) -> tuple[F32, F32 | None]:
        """Return the target positions of all splats.

        Args:
            state: The splats; only rest positions and masks matter.
            moment: Values of the stage at the time.
            seconds: Time since the simulation's start [s].
            gradient: Whether to compute the deformation gradient too.

        Returns:
            Positions [unit], shape (n, 3), the state's own array if nothing moves them; and
            deformation gradients, shape (n, 3, 3), or None if nothing deforms.
        """
        if not moment.deformers and self._skin is None and self._conform is None:
            return state.rest_positions, None
        positions = state.rest_positions.copy()
        turned = None
        binds = self._conform is not None and not self._conform.is_bound
        if gradient or binds:  # splats are bound in their deformed orientation
            turned = np.empty((len(state), 3, 3), np.float32)
            turned[:] = np.eye(3)
        deformers = [self._masked(each, state, moment) for each in moment.deformers]
        deform(self._device, deformers, seconds, positions, turned)
        if self._skin is not None and moment.skin is not None:
            part = self._masks.factor(state, moment, "skin:weight")
            self._skin.apply(moment.skin, moment.parameters.skin, positions, turned, part)
        part = self._masks.factor(state, moment, "conform:weight")
        if isinstance(self._conform, Morph):
            self._conform.reset(state.rest_positions, positions, turned)
            self._conform.apply(None, seconds, moment.parameters.conform, positions, turned, part)
        elif self._conform is not None and moment.target is not None:
            self._conform.apply(
                moment.target, seconds, moment.parameters.conform, positions, turned, part
            )
        elif isinstance(self._conform, TransportConform):
            self._conform.pause()
        return positions, turned if gradient else None

    def joining(self, moment: Moment, seconds: float) -> SplatCloud | None:
        """Return the splats of another capture that must join now, or None."""
        if not isinstance(self._conform, Morph):
            return None
        is_due = self._conform.is_due(seconds, moment.parameters.conform)
        return self._conform.joining if is_due else None

    def append_joined(self, count: int) -> None:
        """Bind the splats that `joining` returned, after they became the last rows."""
        assert isinstance(self._conform, Morph)
        self._conform = self._conform.joined()
        if self._skin is not None:
            self._skin = self._skin.extended(np.zeros(count, np.int64))

    @property
    def opacity(self) -> F32 | None:
        """Factors of opacities at the time of the last pose, shape (n,), or None."""
        return self._conform.opacity() if isinstance(self._conform, Morph) else None

    def finished(self, frame: Frame) -> Frame:
        """Return a frame at the time of the last pose with the look of splats on their way."""
        if not isinstance(self._conform, TransportConform):
            return frame
        return self._conform.finished(frame)

    def append_children(self, parents: I64, state: State) -> None:
        """Bind children like their parents.

        Args:
            parents: Rows of the parents, shape (c,).
            state: Its last c rows are the children.
        """
        n = len(state) - len(parents)
        if self._skin is not None:
            self._skin = self._skin.extended(parents)
        if self._conform is not None:
            self._conform = self._conform.extended(
                parents,
                state.rest_positions[n:],
                state.rest_rotations[n:],
                state.rest_scales[n:],
                state.ids[n:],
            )

    def select(self, rows: I64) -> None:
        """Drop all other rows."""
        if self._skin is not None:
            self._skin = self._skin.selected(rows)
        if self._conform is not None:
            self._conform = self._conform.selected(rows)

    def remember(self, state: State) -> None:
        """Add to the state what `restore` needs."""
        for name, part in self._parts():
            for key, array in part.memory().items():
                state.globals[f"{name}:{key}"] = array

    def restore(self, state: State) -> None:
        """Set the values that `remember` saved in `state`, with the same bits."""
        for name, part in self._parts():
            lead = f"{name}:"
            part.restore(
                {
                    key.removeprefix(lead): array
                    for key, array in state.globals.items()
                    if key.startswith(lead)
                }
            )

    def _masked(self, deformer: Deformer, state: State, moment: Moment) -> Deformer:
        """Return a deformer with the factor of its weight. Displacements by noise, curl and wave
        are proportional to the amount, whose mask is therefore a factor of the weight too."""
        lead, p = f"deform:{deformer.name}", deformer.parameters
        mask = self._masks.factor(state, moment, f"{lead}:weight", p)
        if p.type in ("noise", "curl", "wave"):
            other = self._masks.factor(state, moment, f"{lead}:amount", p)
            mask = other if mask is None else mask if other is None else mask * other
        return deformer if mask is None else replace(deformer, mask=mask)

    def _parts(self) -> Iterator[tuple[str, Skin | Conform | TransportConform]]:
        if self._skin is not None:
            yield "skin", self._skin
        if self._conform is not None:
            yield "conform", self._conform
