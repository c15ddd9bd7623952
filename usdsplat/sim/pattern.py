"""Pattern and local density of a field, on which births and sizes depend.

Both are evaluated on splats at rest, where growth has moved them: bending a surface does not change
its pattern. Data of splats is in the state's memory, so that children inherit it.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.progress import phase
from usdsplat.kernels.device import Device
from usdsplat.sim import support as supports
from usdsplat.sim.carriers import Binding, Carriers
from usdsplat.sim.closest import Triangles
from usdsplat.sim.front import Front
from usdsplat.sim.influence import Influence
from usdsplat.sim.neighbors import Neighbors, nearest
from usdsplat.sim.normals import axes, captured, grown, manifold_dimension
from usdsplat.sim.reaction import Reaction
from usdsplat.sim.relaxing import Projection, relax
from usdsplat.sim.seeds import nuclei, plant, untouched
from usdsplat.sim.specs import Moment, Surface
from usdsplat.sim.state import State
from usdsplat.sim.styles import reaction_of
from usdsplat.sim.support import Neighborhood
from usdsplat.sim.uses import Uses

NORMALS, CROWDING, REST_SUPPORT = (f"pattern:{name}" for name in ("normals", "crowding", "support"))
"""In `State.memory`: normals at rest, (n, 3); number of neighbours relative to the target, and
initial radius of the neighbourhood, (n,)."""
UV, SHAPE, RESOLVED, _LISTS = "pattern:uv", "pattern:shape", "pattern:resolved", "neighbors:"
"""In `State.globals`: u and v of the carriers; dimension and usual support; automatic parameters;
neighbour lists."""
MOST_PARTS = 1000
"""Most parts that one reaction step is divided into for stability; more would take too long."""
_AUTOMATIC = ("patternScale", "reactionSubdivisions", "dimension", "hMin", "hMax")


class Pattern:
    """Pattern of one field.

    Args:
        device: Runs the kernels.
        rest: The capture.
        uses: What the simulation needs.
        first: The values of the stage at the first frame.
        carriers: Carriers of the field, if the reaction runs on them.
    """

    def __init__(
        self,
        device: Device,
        rest: SplatCloud,
        uses: Uses,
        first: Moment,
        carriers: Carriers | None = None,
    ) -> None:
        p = first.parameters
        self._device, self._uses, self._seed = device, uses, p.sim.seed
        self._needs_graph = uses.needs_neighbors or uses.needs_normals or p.rd.domain == "self"
        self._neighbors = Neighbors(device, p.neighbors, symmetric=True, seed=p.sim.seed)
        self._carriers: Carriers | None = None
        self._from: I32 | None = None
        self._reaction: Reaction | None = None
        self.dimension = 2
        """2 for splats on surfaces, 3 in volumes."""
        self.usual_support = 0.0
        """Median radius of a neighbourhood at the beginning [unit]."""
        if uses.reacts and p.rd.domain == "carrier":
            assert carriers is not None
            self._carriers = carriers
            self._from = nearest(device, rest.positions, self._carriers.positions, 1)[0][:, 0]
            self._ids = np.arange(len(rest)) if rest.ids is None else rest.ids

    # --- the beginning, and going on ------------------------------------------------------

    def begin(self, state: State, first: Moment) -> None:
        """Compute normals, dimension and radii, redistribute splats if asked to, and seed the
        pattern."""
        p = first.parameters
        if self._needs_graph:
            with phase("neighbours and normals", work=len(state)):
                self._measure_rest(state, first)
        elif self._uses.collides:  # pushed sheets need normals of any sign
            state.memory[NORMALS] = axes(self._device, state.rest_rotations, state.rest_scales)
        found = np.zeros(len(_AUTOMATIC))  # 0 for automatic parameters that are unused
        if self._needs_graph:
            found[2:] = self.dimension, *self._neighbors.limits
        state.globals[RESOLVED] = found
        if not self._uses.reacts:
            return
        if self._carriers is not None:
            uv = untouched(len(self._carriers))
            reaction = self._current_reaction(state, first)
            places, ids, selection = self._carriers.positions, None, state.weight[self._from]
        else:
            uv = untouched(len(state))
            reaction = self._current_reaction(state, first)
            places, ids, selection = state.rest_positions, state.ids, state.weight
        if self._carriers is not None and p.rd.front_speed > 0:
            Front(self._device, self._carriers, p.rd, self._seed).begin(state, selection)
        else:
            weight = nuclei(
                self._device, places, p.rd, reaction.scale, seed=self._seed, ids=ids,
                selection=selection, graph=reaction.graph,
            )  # fmt: skip
            plant(self._device, uv, weight)
        self._store(state, uv)
        found[:2] = reaction.scale, reaction.subdivisions

    def remember(self, state: State) -> None:
        """Add to the state what `restore` needs."""
        for key, array in self._neighbors.memory().items():
            state.globals[_LISTS + key] = array

    def restore(self, state: State) -> None:
        """Set the values that `remember` saved in `state`, with the same bits."""
        if SHAPE in state.globals:
            dimension, self.usual_support = (float(each) for each in state.globals[SHAPE])
            self.dimension = int(dimension)
        self._neighbors.restore(
            {
                key.removeprefix(_LISTS): array
                for key, array in state.globals.items()
                if key.startswith(_LISTS)
            }
        )

    # --- what others ask ------------------------------------------------------------------

    def normals(self, state: State) -> F32:
        """Return normals at rest, shape (n, 3); of any sign where only shapes need them, else
        zero."""
        found: F32 | None = state.memory.get(NORMALS)
        return np.zeros((len(state), 3), np.float32) if found is None else found

    def crowding(self, state: State) -> F32:
        """Return the number of neighbours relative to the target, shape (n,); empty if nothing
        needs it."""
        found: F32 | None = state.memory.get(CROWDING)
        return np.empty(0, np.float32) if found is None else found

    def neighborhood(self, state: State, moment: Moment) -> Neighborhood:
        """Return what births depend on."""
        return Neighborhood(
            normals=self.normals(state),
            crowding=self.crowding(state),
            dimension=self.dimension,
            target=moment.parameters.neighbors.target,
            usual_support=self.usual_support,
        )

    def sizes(self, state: State, moment: Moment, masked: F32 | None = None) -> F32 | None:
        """Return the factor of each splat's size as spacing grows, shape (n,); None if all
        are 1. `masked` is the factor of `growth:sizeFollow`, shape (n,)."""
        follow = moment.parameters.growth.size_follow
        if not follow or REST_SUPPORT not in state.memory:
            return None
        before = state.memory[REST_SUPPORT]
        ratio = np.where(before > 0, state.support / np.where(before > 0, before, 1), 1)
        exponent = np.float32(follow) if masked is None else np.float32(follow) * masked
        return np.power(ratio, exponent).astype(np.float32)

    def resolved(self, state: State) -> dict[str, float]:
        """Return the values that automatic parameters took at the beginning."""
        values = state.globals[RESOLVED].tolist()
        return {name: each for name, each in zip(_AUTOMATIC, values, strict=True) if each > 0}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about the pattern; their path is that of the property."""
        reaction = self._reaction
        if reaction is None or not reaction.is_too_fine:
            return ()
        expected = (
            f"{reaction.spacing:g} or more: points at this distance do not resolve a finer pattern"
        )
        where = "splatSim:rd:patternScale"
        return (finding("fine-pattern", where, f"{reaction.scale:g}", expected),)

    # --- a frame --------------------------------------------------------------------------

    def react(
        self,
        state: State,
        moment: Moment,
        influence: Influence,
        now: float,
        *,
        feed_factor: F32 | None = None,
        kill_factor: F32 | None = None,
    ) -> None:
        """Take the reaction steps of a frame.

        Args:
            state: The splats.
            moment: Values of the stage.
            influence: Effects of affectors.
            now: Time since the start [s].
            feed_factor, kill_factor: Factors of the rates at the splats, shape (n,).
        """
        reaction = self._current_reaction(state, moment)
        reaction.adopt(reaction_of(moment.parameters))
        if reaction.subdivisions > MOST_PARTS:
            found = f"{reaction.scale:g}, {reaction.scale / reaction.spacing:.0f} spacings"
            expected = "a few spacings: larger units need more and smaller steps"
            raise StageError("splatSim:rd:patternScale", found, expected)
        uv: F32 = state.globals[UV] if self._carriers is not None else state.uv
        seed, feed = (self._at_carriers(state, each) for each in (influence.seed, influence.feed))
        rd = moment.parameters.rd
        if self._carriers is not None and rd.front_speed > 0:
            seed = Front(self._device, self._carriers, rd, self._seed).reached(state, seed, now)
        if seed is not None:
            uv = uv.copy()
            plant(self._device, uv, seed)
        feeds, kills = (self._at_carriers(state, each) for each in (feed_factor, kill_factor))
        after = reaction.step(uv, feed_offset=feed, feed_factor=feeds, kill_factor=kills)
        self._store(state, after)

    def update_density(self, state: State, moment: Moment) -> None:
        """Count neighbours, and adapt the radii to the density."""
        self._neighbors.parameters = moment.parameters.neighbors
        graph = self._neighbors.update(state.rest_positions, state.support)
        count = supports.crowding(self._device, graph, self.dimension)
        if not supports.fits(self._neighbors, state.support, count):
            state.support = supports.corrected(
                self._neighbors, state.support, count, self.dimension
            )
        state.memory[CROWDING] = count / np.float32(moment.parameters.neighbors.target)

    # --- private --------------------------------------------------------------------------

    def _measure_rest(self, state: State, first: Moment) -> None:
        """Compute dimension, normals and radii of the splats at rest."""
        p, device, neighbors = first.parameters, self._device, self._neighbors
        dimension = 3 if p.sim.dimension == "3" else 2
        rest = state.rest_positions
        # normals alone do not need even neighbourhoods, whose fit takes most of a beginning
        needs_even = self._uses.needs_neighbors or p.rd.domain == "self"
        steps = supports.STEPS if needs_even else 0
        state.support = supports.fitted(neighbors, rest, dimension, steps)
        graph = neighbors.update(rest, state.support)
        if p.sim.dimension == "auto":
            _, surfaceness = grown(device, graph, np.zeros_like(rest))
            dimension = manifold_dimension(surfaceness)
            if dimension == 3:
                state.support = supports.fitted(neighbors, rest, dimension, steps)
                graph = neighbors.update(rest, state.support)
        state.memory[NORMALS] = captured(device, graph, state.rest_rotations, state.rest_scales)
        self.dimension = dimension
        if self._uses.reacts and p.rd.domain == "self" and p.relax.iterations:
            state.rest_positions, state.support = relax(
                device, rest, state.memory[NORMALS] if dimension == 2 else None, p,
                p.relax.iterations, _projection(device, first.relax_surface), dimension=dimension,
            )  # fmt: skip
            neighbors.update(state.rest_positions, state.support)
        if self._uses.needs_neighbors:
            self.update_density(state, first)
        state.memory[REST_SUPPORT] = state.support.copy()
        self.usual_support = float(np.median(state.support))
        state.globals[SHAPE] = np.array([self.dimension, self.usual_support])

    def _current_reaction(self, state: State, moment: Moment) -> Reaction:
        """Return the reaction on the points as they are now."""
        p = moment.parameters
        rd = reaction_of(p)
        if self._carriers is not None:
            if self._reaction is None:
                c = self._carriers
                self._reaction = Reaction(
                    self._device,
                    c.graph,
                    rd,
                    dimension=c.dimension if p.sim.dimension == "auto" else int(p.sim.dimension),
                    normals=c.normals,
                )
            return self._reaction
        self._neighbors.parameters = moment.parameters.neighbors
        graph = self._neighbors.update(state.rest_positions, state.support)
        if self._reaction is None or self._reaction.graph is not graph:
            self._reaction = Reaction(
                self._device, graph, rd, dimension=self.dimension,
                normals=self.normals(state) if self.dimension == 2 else None,
            )  # fmt: skip
        return self._reaction

    def _store(self, state: State, uv: F32) -> None:
        """Store the pattern, and interpolate it at the splats."""
        if self._carriers is None:
            state.uv = uv
            return
        state.globals[UV] = uv
        state.uv = Binding.kept(state).read(self._device, uv)

    def _at_carriers(self, state: State, values: F32 | None) -> F32 | None:
        """Return values per splat at the points of the reaction."""
        if values is None or self._carriers is None:
            return values
        rows = np.searchsorted(state.ids, self._ids[self._from])  # captured splats may have died
        return values[np.minimum(rows, len(values) - 1)]


def _projection(device: Device, surface: Surface | None) -> Projection | None:
    """Return the projection of points onto a mesh."""
    if surface is None:
        return None
    triangles = Triangles(device, surface)

    def project(points: F32) -> tuple[F32, F32]:
        hits = triangles.closest(points)
        corners = surface.points[surface.triangles[hits.faces]].astype(np.float64)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(across, axis=1, keepdims=True)
        normals = across / np.where(length > 0, length, 1)
        return hits.points, normals.astype(np.float32)

    return project
