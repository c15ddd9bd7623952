"""Read the simulations of a stage: a recipe for each field of each SplatSim prim.

Prims and attributes are found by name, so that USD need not know our schemas. The stage must not
change while its recipes are in use.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from pxr import Usd

from usdsplat import schema
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding
from usdsplat.schema.stage_values import up_axis
from usdsplat.sim.parameters import (
    NAMESPACE,
    ConformParameters,
    DeformParameters,
    DriverParameters,
    Parameters,
    SimParameters,
    SkinParameters,
)
from usdsplat.sim.specs import Deformer, Driver, Moment, SkinBinding
from usdsplat.sim.stage import collections, fields
from usdsplat.sim.stage.affectors import AffectorReader
from usdsplat.sim.stage.binding import SKELETON, BindingReader
from usdsplat.sim.stage.captures import TARGET, target_capture, with_degree
from usdsplat.sim.stage.collections import find_simulations
from usdsplat.sim.stage.findings import findings
from usdsplat.sim.stage.masks import MaskReader
from usdsplat.sim.stage.parameters import FRAME, instances, read, read_all
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.spaces import Space, up_in
from usdsplat.sim.stage.targets import SurfaceReader, related
from usdsplat.sim.stage.trees import simulated_cut

__all__ = ["UNGUARDED", "StageRecipe", "find_simulations", "recipes"]

UNGUARDED: AbstractContextManager[Any] = nullcontext()
"""Lock for a stage that only one thread uses."""

RELAX_SURFACE = f"{NAMESPACE}:relax:surface"


def recipes(
    stage: Usd.Stage,
    simulation: Usd.Prim,
    *,
    start: float | None = None,
    reading: AbstractContextManager[Any] = UNGUARDED,
    kind: Callable[..., StageRecipe] | None = None,
    paths: Sequence[str] | None = None,
) -> tuple[StageRecipe, ...]:
    """Return one recipe for each field of a simulation, ordered by path.

    Args:
        stage: The stage.
        simulation: A SplatSim prim.
        start: First frame that is simulated [time code]; None is the stage's first. The
            simulation's own start time takes precedence.
        reading: Entered whenever the stage is read; see `StageRecipe`.
        kind: Class of the recipes; None is `StageRecipe`.
        paths: Paths of the fields; None is the simulation's own collection.

    Raises:
        UsdSplatError: If something that the simulation needs is missing or cannot be used.
    """
    make = kind or StageRecipe
    rigs = Rigs()
    with reading:
        found, left_out = collections.splats(stage, simulation)
        if paths is not None:
            found = [stage.GetPrimAtPath(path) for path in paths]
        first = stage.GetStartTimeCode() if start is None else start
        return tuple(make(simulation, prim, rigs, first, left_out, reading) for prim in found)


class StageRecipe:
    """One field and everything that acts on it; see `sim.specs.Recipe`.

    It is made while `reading` is entered, and enters it whenever it reads the stage: a lock, where
    other threads read and write the stage.

    Args:
        simulation: The SplatSim prim.
        field: The splat field, or a splat tree.
        rigs: Skinning of the stage.
        first: First frame that is simulated [time code].
        said: Findings about the simulation so far.
        reading: Entered while the stage is read; it must be reentrant.
    """

    def __init__(
        self,
        simulation: Usd.Prim,
        field: Usd.Prim,
        rigs: Rigs,
        first: float,
        said: list[Finding] | None = None,
        reading: AbstractContextManager[Any] = UNGUARDED,
    ) -> None:
        self._simulation, self._field, self._rigs = simulation, field, rigs
        self._reading = reading
        self.path = str(field.GetPath())
        """Path of the field."""
        self.simulation = str(simulation.GetPath())
        """Path of the SplatSim prim."""
        stage = simulation.GetStage()
        asked = read(simulation, SimParameters, f"{NAMESPACE}:sim", Usd.TimeCode.Default())
        self.start = asked.start_time if math.isfinite(asked.start_time) else first
        """First frame of the simulation [time code]."""
        self._space = Space(field, asked.space, Usd.TimeCode(self.start))
        self.cut = simulated_cut(field, asked) if schema.is_tree(field) else None
        """The cut of a splat tree; None for a field."""
        self._rest, of_field = fields.read_rest(field, self._space.start, self.cut)
        self._selection = fields.read_selection(field, len(self._rest), self._space.start)
        members = collections.affectors(stage, simulation)
        self._affectors = [AffectorReader(prim, self._space, rigs) for prim in members]
        self._becomes = target_capture(simulation, self._space)
        self._target = None if self._becomes else self._surface(TARGET)
        if self._becomes is not None:
            self._rest = with_degree(self._rest, self._becomes)
        self._order = self._read_order()
        self._relax_surface = self._surface(RELAX_SURFACE)
        self._frames = {
            name: related(simulation, f"{NAMESPACE}:deform:{name}:{FRAME}")
            for name in instances(simulation, "deform")
        }
        self._drivers = instances(simulation, "driver")
        self._masks = MaskReader(simulation, field, len(self._rest), self._space, rigs, members)
        self._skin = self._bind()
        self.codes_per_second = float(stage.GetTimeCodesPerSecond())
        """Time codes per second."""
        self.findings: tuple[Finding, ...] = (
            *(said or ()),
            *of_field,
            *findings(simulation, members),
        )
        """What the stage asks for and the simulation does not do."""

    @property
    def rest(self) -> SplatCloud:
        """The capture at the start, in the simulation's space."""
        return self._rest

    @property
    def selection(self) -> F32 | None:
        """`primvars:splatSim:weight`, shape (n,), 0 to 1; None where all are selected."""
        return self._selection

    @property
    def files(self) -> tuple[str, ...]:
        """Resolved paths of input files that are not layers of the stage: the chunks of a tree, and
        files of masks."""
        return (*(self.cut.files if self.cut else ()), *self._masks.files)

    @property
    def binding(self) -> SkinBinding | None:
        """Binding of the field to a skeleton, or None."""
        return self._skin.binding if self._skin else None

    def at(self, time: float) -> Moment:
        """Return the values of the stage at a time code, whole or fractional.

        Raises:
            StageError: If a value is out of range.
        """
        with self._reading:
            code = Usd.TimeCode(time)
            masks, masked = self._masks.at(code)
            parameters = self.parameters(time)
            if parameters.dissolve.by == "mask" and "dissolve:by" not in masked:
                where = f"{self.simulation}.{NAMESPACE}:dissolve:by"
                raise StageError(where, "mask, and no mask of it", f"{where}:mask with a name")
            to_world = self._space.to_world(code)
            return Moment(
                time=time,
                parameters=parameters,
                to_world=to_world,
                up=up_in(to_world, up_axis(self._simulation.GetStage())),
                affectors=tuple(each.at(code) for each in self._affectors),
                target=self._target.at(code) if self._target else None,
                becomes=self._becomes,
                order=self._order,
                relax_surface=self._relax_surface.at(code) if self._relax_surface else None,
                deformers=self._deformers(code),
                drivers=tuple(self._driver(name, code) for name in self._drivers),
                skin=self._skin.at(code) if self._skin else None,
                masks=masks,
                masked=masked,
            )

    def parameters(self, time: float) -> Parameters:
        """Return all parameters of the simulation at a time code."""
        with self._reading:
            return read_all(self._simulation, Usd.TimeCode(time))

    def field_to_simulation(self, time: float) -> F64:
        """Return the matrix from the field's space at a time code to the simulation's, shape
        (4, 4)."""
        with self._reading:
            return self._space.from_prim(self._field, Usd.TimeCode(time))

    # --- private ---------------------------------------------------------------------------

    def _surface(self, name: str) -> SurfaceReader | None:
        prim = related(self._simulation, name)
        return SurfaceReader(prim, self._space, self._rigs) if prim else None

    def _read_order(self) -> F32 | None:
        """Return the primvar that says when splats start to conform."""
        code, lead = Usd.TimeCode.Default(), f"{NAMESPACE}:conform"
        name = read(self._simulation, ConformParameters, lead, code).order_primvar
        if not name or (self._target is None and self._becomes is None):
            return None
        found = fields.per_splat(self._field, name, len(self._rest), self._space.start)
        if found is None:
            raise fields.missing(self._simulation, f"{lead}:orderPrimvar", name, self._field)
        return found

    def _bind(self) -> BindingReader | None:
        skeleton = related(self._simulation, SKELETON)
        if skeleton is None:
            return None
        asked = read(self._simulation, SkinParameters, f"{NAMESPACE}:skin", Usd.TimeCode.Default())
        return BindingReader(
            self._simulation,
            skeleton,
            len(self._rest),
            self._space,
            self._rigs,
            by_triangles=asked.binding == "triangles",
        )

    def _deformers(self, code: Usd.TimeCode) -> tuple[Deformer, ...]:
        found = [self._deformer(name, code) for name in self._frames]
        return tuple(sorted(found, key=lambda each: (each.parameters.order, each.name)))

    def _deformer(self, name: str, code: Usd.TimeCode) -> Deformer:
        lead = f"{NAMESPACE}:deform:{name}"
        asked = read(self._simulation, DeformParameters, lead, code)
        prim = self._frames[name]
        frame = self._space.from_prim(prim, code) if prim else np.eye(4)
        where = f"{self._simulation.GetPath()}.{lead}"
        if not abs(np.linalg.det(frame[:3, :3])) > 0:
            raise StageError(
                f"{where}:{FRAME}", "a prim with a singular transform", "an invertible one"
            )
        count = math.prod(asked.divisions)
        if asked.type == "lattice" and len(asked.points) not in (0, count):
            found = f"{len(asked.points)} points"
            raise StageError(f"{where}:points", found, f"{count}, as many as divisions say")
        return Deformer(name=name, parameters=asked, frame=frame)

    def _driver(self, name: str, code: Usd.TimeCode) -> Driver:
        lead = f"{NAMESPACE}:driver:{name}"
        return Driver(name=name, parameters=read(self._simulation, DriverParameters, lead, code))
