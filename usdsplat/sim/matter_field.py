"""Splats of one field that follow its matter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.core.sh import dc_to_rgb
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import following as kernels
from usdsplat.sim.carriers import NEAR, Binding, Carriers
from usdsplat.sim.infill import Infill
from usdsplat.sim.masks import Masks
from usdsplat.sim.materials import breaks, resolved
from usdsplat.sim.matter import Matter
from usdsplat.sim.neighbors import nearest
from usdsplat.sim.specs import Moment, Recipe, SkinBinding
from usdsplat.sim.state import FREE, State
from usdsplat.sim.target_pose import TargetPose
from usdsplat.sim.timeline import Step

AROUND = 8
"""Number of splats around a carrier of which its colour is the mean."""
NOTHING = (None, None, None)
_MATTER = "matter:"
"""Start of the keys in `State.globals`."""


class CarrierRecipe:
    """A recipe of the carriers of a field: they are deformed and skinned as the splats are.

    Args:
        recipe: The field.
        carriers: Its carriers.
        rows: The splat of the field that is nearest to each carrier, shape (c,).
    """

    def __init__(self, recipe: Recipe, carriers: Carriers, rows: I32) -> None:
        self._recipe, self._rows = recipe, rows
        c = len(carriers)
        self.path = recipe.path
        """Path of the field."""
        self.rest = SplatCloud(
            positions=carriers.positions,
            scales=np.full((c, 3), carriers.spacing, np.float32),
            rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (c, 1)),
            opacities=np.ones(c, np.float32),
            sh=np.zeros((c, 1, 3), np.float32),
        )
        """The carriers, as round splats."""
        own = recipe.selection
        self.selection = np.ones(c, np.float32) if own is None else own[rows]
        """Selection weight of each carrier, shape (c,)."""
        self.binding = _bound(recipe.binding, rows)
        """Binding to the field's skeleton, or None."""
        self.codes_per_second = recipe.codes_per_second
        """Time codes in a second."""

    def at(self, time: float) -> Moment:
        """Return the values of the stage for carriers."""
        return self.of(self._recipe.at(time))

    def of(self, moment: Moment) -> Moment:
        """Return values of the field for the poses of its carriers. A target of conform is left
        out: splats move onto it by themselves."""
        masks = {
            name: each if each.primvar is None else replace(each, primvar=each.primvar[self._rows])
            for name, each in moment.masks.items()
        }
        of_poses = ("deform:", "skin:")
        masked = {knob: n for knob, n in moment.masked.items() if knob.startswith(of_poses)}
        return replace(moment, masks=masks, masked=masked, affectors=(), target=None, becomes=None)


class MatterField:
    """The matter of one field, and the splats that follow it.

    Args:
        device: Runs the kernels.
        recipe: The field.
        carriers: Its carriers.
        first: Values of the stage at the first frame.
    """

    def __init__(self, device: Device, recipe: Recipe, carriers: Carriers, first: Moment) -> None:
        self._device = device
        rows = nearest(device, recipe.rest.positions, carriers.positions, 1)[0][:, 0]
        self._recipe = CarrierRecipe(recipe, carriers, rows)
        self._masks = Masks(device, is_fixed=True)
        self._pose = TargetPose(device, self._recipe, self._recipe.of(first), self._masks)
        colors = carrier_colors(device, recipe.rest, carriers)
        self.matter = Matter(device, carriers, self._recipe.selection, colors, first)
        """The carriers as particles."""
        self._followed: tuple[Any, Any, Any] = NOTHING
        """Positions of the carriers that splats were moved with, the carriers of each splat, and
        the gradients of that motion, None where splats are deformed otherwise, too."""
        knobs = resolved(first.parameters.matter)
        self.filling: Infill | None = None
        """What fills pieces that break off; None for matter that does not break into pieces."""
        if self.matter.pieces is not None and breaks(knobs) and knobs.fill:
            ids = np.arange(len(recipe.rest)) if recipe.rest.ids is None else recipe.rest.ids
            self.filling = Infill(
                device, carriers, self.matter.pieces, colors=colors,
                up=np.asarray(first.up, np.float32), parents=ids[rows], size=knobs.grain,
                seed=first.parameters.sim.seed,
            )  # fmt: skip

    def bound(self, binding: Binding) -> Binding:
        """Return the carriers that splats follow: those of one rigid piece, if there are pieces,
        which is the one with the largest weight. They come first."""
        if self.matter.pieces is None:
            return binding
        piece = np.where(binding.near >= 0, self.matter.pieces.piece[binding.near], -1)
        alike = piece[:, :, None] == piece[:, None, :]
        votes = (alike * binding.weights[:, None, :]).sum(axis=2)
        best = np.argmax(votes, axis=1)[:, None]
        own = piece == np.take_along_axis(piece, best, axis=1)
        order = np.argsort(~own, axis=1, kind="stable")
        near = np.take_along_axis(binding.near, order, axis=1)
        kept = np.take_along_axis(np.where(own, binding.weights, 0), order, axis=1)
        kept[kept.sum(axis=1) == 0, 0] = 1
        total = kept.sum(axis=1, keepdims=True)
        return Binding(near=near, weights=(kept / total).astype(np.float32))

    def affectors(self, moment: Moment) -> Moment:
        """Return values of the stage with the ground among the affectors."""
        ground = self.matter.ground
        if ground is None:
            return moment
        return replace(moment, affectors=(*moment.affectors, ground))

    def places(self) -> F32:
        """Return where the carriers are now [unit], shape (c, 3)."""
        return self._device.fetch(self.matter.particles.positions)

    def begin(self, moment: Moment, seconds: float) -> None:
        """Put the carriers at their poses."""
        self.matter.move_to(self._poses(moment, seconds))

    def advance(self, before: Moment, after: Moment, step: Step) -> None:
        """Take a substep of the carriers."""
        self.matter.advance(self._poses(after, step.now), before, after, step)

    def place(self, state: State, moment: Moment, wanted: F32, seconds: float) -> None:
        """Move the splats with the carriers, at a frame; flying splats are left alone.

        Args:
            state: Its positions and velocities change.
            moment: Values of the stage now.
            wanted: Target positions [unit], shape (n, 3).
            seconds: Time since the last frame [s].
        """
        device, own = self._device, wanted is state.rest_positions
        total = self._undeformed(len(state)) if own else None
        device.keep(wanted)
        positions, velocities = device.copied(wanted), device.copied(state.velocities)
        self.matter.follow(Binding.kept(state), moment, positions, total)
        self._followed = self.matter.particles.positions, state.memory[NEAR], total
        device.run(
            kernels.arrive, state.positions, state.flags, FREE, np.float32(seconds), positions,
            velocities,
        )  # fmt: skip
        state.positions, state.velocities = map(device.publish, (positions, velocities))

    def carried(self, state: State, moment: Moment, wanted: F32, gradient: F32 | None) -> Any:
        """Return the gradients of the deformation from rest to the splats that follow the matter,
        shape (n, 3, 3), an array of the device.

        Args:
            state: The splats.
            moment: Values of the stage now.
            wanted: Target positions [unit], shape (n, 3).
            gradient: Gradients of the deformation to there, shape (n, 3, 3); None without any.
        """
        device, (places, near, total) = self._device, self._followed
        self._followed = NOTHING  # the caller may change the gradients
        is_now = places is self.matter.particles.positions and near is state.memory[NEAR]
        if gradient is None and total is not None and is_now:
            return total  # they depend on the carriers, not on the places of splats
        total = self._undeformed(len(state)) if gradient is None else device.move(gradient)
        self.matter.follow(Binding.kept(state), moment, device.copied(wanted), total)
        return total

    def _undeformed(self, count: int) -> Any:
        """Return new gradients without deformation, shape (count, 3, 3)."""
        total = self._device.resident((count, 3, 3), np.float32)
        self._device.run(kernels.undeformed, total)
        return total

    def remember(self, state: State) -> None:
        """Add to the state what `restore` needs."""
        for key, array in self.matter.memory().items():
            state.globals[_MATTER + key] = array

    def restore(self, state: State) -> None:
        """Set the values that `remember` saved in `state`, with the same bits."""
        self.matter.restore(
            {
                key.removeprefix(_MATTER): array
                for key, array in state.globals.items()
                if key.startswith(_MATTER)
            }
        )

    def _poses(self, moment: Moment, seconds: float) -> F32:
        """Return the target positions of the carriers [unit], shape (c, 3)."""
        particles, own = self.matter.particles, self._recipe.of(moment)
        self._masks.update(particles, own, seconds)
        return self._pose.at(particles, own, seconds)[0]


def carrier_colors(device: Device, cloud: SplatCloud, carriers: Carriers) -> F32:
    """Return the mean colour of the splats around each carrier, shape (c, 3)."""
    near, _ = nearest(device, cloud.positions, carriers.positions, AROUND)
    weights = np.where(near >= 0, cloud.opacities[near], 0)[..., None]
    colors = dc_to_rgb(cloud.sh[:, 0])[near]
    total = np.maximum(weights.sum(axis=1), np.float32(1e-6))
    return np.asarray((weights * colors).sum(axis=1) / total, np.float32)


def _bound(binding: SkinBinding | None, rows: I32) -> SkinBinding | None:
    """Return the binding of some of a capture's splats."""
    if binding is None or binding.indices is None or binding.weights is None:
        return binding
    return replace(binding, indices=binding.indices[rows], weights=binding.weights[rows])
