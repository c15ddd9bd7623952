"""Watch a stage while its simulation runs, and report changes that need a reset.

Parameters and transforms are read again at every step. An invalid value is reported, and the step
waits for a valid one: the simulation loses nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from pxr import Sdf, Tf, Usd

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.preview.simulating.pinning import Pins
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.specs import Moment
from usdsplat.sim.stage import collections
from usdsplat.sim.stage.parameters import NAMED_RELATIONSHIPS, RELATIONSHIPS, instances
from usdsplat.sim.stage.recipe import StageRecipe, find_simulations
from usdsplat.sim.stage.simulation import Simulation

_NAMES = (f"{NAMESPACE}:", "collection:")


def members(stage: Usd.Stage) -> dict[str, Usd.Prim]:
    """Return the prims that take part in a stage's simulations, by the names shown to users.

    The name of a link's target ends with the target's path.
    """
    found: dict[str, Usd.Prim] = {}
    for simulation in find_simulations(stage):
        path = simulation.GetPath()
        found[str(path)] = simulation
        fields, _ = collections.splats(stage, simulation)
        for prim in (*fields, *collections.affectors(stage, simulation)):
            found[f"{path}: {prim.GetPath()}"] = prim
        links = list(RELATIONSHIPS)
        for group, relationships in NAMED_RELATIONSHIPS.items():
            for name in instances(simulation, group):
                found[f"{path}.{NAMESPACE}:{group}:{name}"] = simulation
                links += [f"{group}:{name}:{each}" for each in relationships]
        for name in links:
            relationship = simulation.GetRelationship(f"{NAMESPACE}:{name}")
            for target in relationship.GetForwardedTargets() if relationship else ():
                where = f"{path}.{NAMESPACE}:{name}: {target}"
                found[where] = stage.GetPrimAtPath(target.GetPrimPath())
    return found


class Watch:
    """Watches the stage for one run of its simulation.

    Args:
        stage: The stage, observed until `close` is called.
        refused: Called with the error of a value that cannot be read; it returns when the read
            should be tried again.
    """

    def __init__(self, stage: Usd.Stage, refused: Callable[[StageError], None]) -> None:
        self._stage, self._refused = stage, refused
        self._pins: dict[str, Pins] = {}
        self._members: dict[str, Usd.Prim] = {}
        self._told: dict[str, tuple[str, ...]] = {}
        self._thread = threading.get_ident()
        self._is_stale = False
        self._key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._notice, stage)

    def close(self) -> None:
        """Stop observing the stage."""
        self._key.Revoke()

    def begin(self, simulation: Simulation) -> None:
        """Record what takes part when a simulation begins. Call it with the stage's lock held.

        Raises:
            UsdSplatError: If something on the stage cannot be simulated.
        """
        self._members = members(self._stage)
        for path, recipe in simulation.recipes.items():
            self._pins[path] = Pins(
                simulation=recipe.simulation,
                first=recipe.at(recipe.start),
                uses=simulation.uses[path],
                has_skin=recipe.binding is not None,
            )

    @property
    def message(self) -> str:
        """Return a sentence about the changes that take effect only after a reset; "" for none."""
        names = list(dict.fromkeys(name for told in self._told.values() for name in told))
        if not names:
            return ""
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        return f"{names[0]}{more}: takes effect after Reset"

    def look(self) -> None:
        """Compare the members with those of the start, if they may have changed. Call it with the
        stage's lock held."""
        if not self._is_stale:
            return
        self._is_stale = False
        changed = members(self._stage).keys() ^ self._members.keys()
        self._told["members"] = tuple(sorted(changed))

    def check(self) -> None:
        """Check that every member still exists.

        Call it with the stage's lock held, before any read.

        Raises:
            StageError: If a prim no longer exists.
        """
        for name, prim in self._members.items():
            if not prim:
                where = name.rpartition(": ")[2]
                raise StageError(where, "a prim that no longer exists", "the prim, or Reset")

    def held(self, path: str, read: Callable[[], Moment]) -> Moment:
        """Return the state of a field, retrying the read until it succeeds."""
        while True:
            try:
                moment = read()
            except StageError as error:
                if path not in self._pins or any(not prim for prim in self._members.values()):
                    raise
                self._refused(error)
                continue
            if path not in self._pins:
                return moment
            moment, told = self._pins[path].held(moment)
            self._told[path] = tuple(told)
            return moment

    def _notice(self, notice: Usd.Notice.ObjectsChanged, sender: Any) -> None:
        if threading.get_ident() == self._thread:
            return  # our own authored frames
        paths = [*notice.GetResyncedPaths(), *notice.GetChangedInfoOnlyPaths()]
        self._is_stale |= any(map(_may_matter, paths))


def _may_matter(path: Sdf.Path) -> bool:
    """Return whether a change at this path may change who takes part."""
    return path.IsAbsoluteRootOrPrimPath() or path.name.startswith(_NAMES)


class LiveRecipe(StageRecipe):
    """A recipe that reads a stage while it is edited. It takes the arguments of `StageRecipe`, and
    the watch of the run."""

    def __init__(self, *arguments: Any, watch: Watch) -> None:
        super().__init__(*arguments)
        self._watch = watch

    def at(self, time: float) -> Moment:
        """Return `StageRecipe.at`, retried until every value can be read."""

        def read() -> Moment:
            with self._reading:
                self._watch.check()
                return StageRecipe.at(self, time)

        return self._watch.held(self.path, read)

    def field_to_simulation(self, time: float) -> F64:
        """Return `StageRecipe.field_to_simulation`, read under the lock."""
        with self._reading:
            self._watch.check()
            return super().field_to_simulation(time)
