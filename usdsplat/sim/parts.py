"""The parts of a solver, which keep what a field needs from step to step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.findings import Finding
from usdsplat.core.progress import phase
from usdsplat.kernels.device import Device
from usdsplat.sim.accretion import Accretion
from usdsplat.sim.carriers import Carriers, carriers_of
from usdsplat.sim.contact import Contacts
from usdsplat.sim.frame_state import FrameEvaluator, turned
from usdsplat.sim.influence import Influences
from usdsplat.sim.limits import limit_findings, room
from usdsplat.sim.masks import Masks
from usdsplat.sim.matter_field import MatterField
from usdsplat.sim.neighbors import nearest
from usdsplat.sim.pattern import Pattern
from usdsplat.sim.specs import Moment, Recipe
from usdsplat.sim.state import State
from usdsplat.sim.strain import Strain
from usdsplat.sim.target_pose import TargetPose
from usdsplat.sim.uses import Uses


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Parts:
    """The parts of one field's solver."""

    carriers: Carriers | None
    """Carriers, if anything needs them."""
    masks: Masks
    target_pose: TargetPose
    pattern: Pattern
    accretion: Accretion | None
    """New matter; None if none grows."""
    matter: MatterField | None
    """Matter that splats follow; None if they are free."""
    contacts: Contacts
    influences: Influences
    evaluator: FrameEvaluator
    findings: tuple[Finding, ...]
    """What is done otherwise than asked; the path of each is that of the property."""

    @classmethod
    def of(cls, device: Device, recipe: Recipe, uses: Uses, first: Moment) -> Parts:
        """Make the parts that a field needs.

        Args:
            device: Runs the kernels.
            recipe: The field.
            uses: What its simulation needs.
            first: Values of the stage at the first frame.
        """
        rest, is_fixed = recipe.rest, not (uses.grows or uses.varies)
        carriers = carriers_of(device, recipe, uses, first)
        found = tuple(limit_findings(recipe, uses, first, carriers))
        surface = carriers if carriers is not None and len(carriers) else None
        masks = Masks(device, is_fixed=is_fixed)
        accretion = matter = None
        has_pattern = first.parameters.rd.domain == "carrier"
        if uses.accretes and surface is not None and has_pattern:
            origin = nearest(device, rest.positions, surface.positions, 1)[0][:, 0]
            own = np.arange(len(rest)) if rest.ids is None else rest.ids
            asked = recipe.selection
            weight = np.ones(len(rest), np.float32) if asked is None else asked
            accretion = Accretion(device, surface, origin, own, weight, first)
            found = (*found, *room(accretion, first, len(rest)))
        if uses.coheres and surface is not None:
            matter = MatterField(device, recipe, surface, first)
        measures = uses.collides and matter is None
        strain = Strain(device, is_fixed=is_fixed) if measures else None
        return cls(
            carriers=carriers,
            masks=masks,
            target_pose=TargetPose(device, recipe, first, masks, surface),
            pattern=Pattern(device, rest, uses, first, carriers),
            accretion=accretion,
            matter=matter,
            contacts=Contacts(device),
            influences=Influences(device),
            evaluator=FrameEvaluator(device, strain, masks),
            findings=found,
        )

    def begin(self, device: Device, state: State, first: Moment) -> None:
        """Prepare the state of a capture at rest."""
        self.masks.begin(state, first)
        if self.carriers is not None:
            with phase("binding to the carriers", work=len(state)):
                bound = self.carriers.bind(device, state.rest_positions)
            if self.matter is not None:
                bound = self.matter.bound(bound)
            bound.keep(state)
        if self.accretion is not None:
            self.accretion.begin(state)
        self.pattern.begin(state, first)

    def normals(self, state: State, moment: Moment, seconds: float) -> F32:
        """Return the normals of splats in their target pose, of which only the impulse of a
        dissolve needs more than the side, shape (n, 3).

        Args:
            state: The splats.
            moment: Values of the stage now.
            seconds: Time since the simulation's start [s].
        """
        normals = self.pattern.normals(state)
        if not moment.parameters.dissolve.speed:
            return normals
        return turned(normals, self.target_pose.at(state, moment, seconds, gradient=True)[1])

    def remember(self, state: State) -> None:
        """Add to the state what `restore` needs."""
        self.target_pose.remember(state)
        self.pattern.remember(state)
        if self.matter is not None:
            self.matter.remember(state)

    def restore(self, state: State) -> None:
        """Set the values that `remember` saved in `state`, with the same bits."""
        self.target_pose.restore(state)
        self.pattern.restore(state)
        if self.matter is not None:
            self.matter.restore(state)
