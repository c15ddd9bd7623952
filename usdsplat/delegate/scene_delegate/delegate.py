"""Answers for the prims of one stage at one time, and says what has changed."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import NO_INSTANCES, InstancerSpec, Placement
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.scene_delegate import placing
from usdsplat.delegate.scene_delegate.cameras import read_camera, shutter_problem
from usdsplat.delegate.scene_delegate.crops import read_crop
from usdsplat.delegate.scene_delegate.dependencies import Dependencies
from usdsplat.delegate.scene_delegate.fields import read_field
from usdsplat.delegate.scene_delegate.instancers import read_instancer
from usdsplat.delegate.scene_delegate.notices import Changes, NoticeListener
from usdsplat.delegate.scene_delegate.population import Appearance, Population, populate
from usdsplat.delegate.scene_delegate.reconcile import reconcile
from usdsplat.delegate.scene_delegate.variability import varying_bits
from usdsplat.delegate.specs import CameraSpec, CropSpec, FieldSpec

T = TypeVar("T")

LOG = logging.getLogger("usdsplat")
"""Tells a Python user, once, of each prim that is left out of the picture; commands say it too."""


class UsdSceneDelegate:
    """A `SceneDelegate` that reads a Usd.Stage and keeps a render index in step with it.

    Edits are collected as they come; `apply_pending_updates` turns them into dirty bits.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        index: RenderIndex,
        *,
        time: float | None,
        purposes: Iterable[str],
    ) -> None:
        self.stage = stage
        self.pulls: Counter[str] = Counter()
        """What was read so far, by kind."""
        self.time = time
        self._applied_time = time
        self._purposes = frozenset(purposes)
        self._index = index
        self._population = Population()
        self._dependencies = Dependencies(self._population)
        self._varying: dict[str, DirtyBits] = {}
        self.problems: dict[tuple[str, str], UsdSplatError] = {}
        """Path and kind of what could not be read -> why."""
        self._xforms = UsdGeom.XformCache(self._code)
        self._rate = stage.GetTimeCodesPerSecond()
        self._is_stale = True
        self._notices = NoticeListener(stage)

    @property
    def up_axis(self) -> str:
        """The stage's upAxis, "Y" or "Z"."""
        return str(UsdGeom.GetStageUpAxis(self.stage))

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each prim that cannot be used as it is, by path."""
        found = {(path, ""): why for path, why in self._population.problems.items()}
        found |= {key: why for key, why in self.problems.items() if self._is_of_interest(*key)}
        return tuple(_told(found[key], key[1]) for key in sorted(found))

    def set_time(self, time: float | None) -> None:
        """Go to another time with the next update."""
        self.time = time

    def set_purposes(self, purposes: Iterable[str]) -> None:
        """Show prims of these purposes from the next sync on."""
        wanted = frozenset(purposes)
        if wanted != self._purposes:
            self._purposes = wanted
            self._index.tracker.mark_all(DirtyBits.RENDER_TAG)

    def close(self) -> None:
        """Stop listening and let go of every prim."""
        self._notices.close()
        self._population = Population()
        self._xforms.Clear()

    # --- what has changed ------------------------------------------------------------------

    def apply_pending_updates(self) -> None:
        """Bring the index's prims and their dirty bits up to date with the stage and the time."""
        changes = self._notices.take()
        self._is_stale |= changes.structural
        rate = self.stage.GetTimeCodesPerSecond()
        changes.everything |= rate != self._rate  # muting a layer changes it without a notice
        self._mark(changes)
        self._rate = rate
        if self._is_stale:
            self._populate()
            self._is_stale = False
        if self.time != self._applied_time:
            self._mark_time(to_or_from_default=None in (self.time, self._applied_time))
            self._applied_time = self.time
        self._xforms = UsdGeom.XformCache(self._code)

    def _populate(self) -> None:
        found = populate(self.stage)
        reconcile(self._index, self._population, found)
        self._population = found
        self._dependencies = Dependencies(found)
        self._varying.clear()
        self.problems = {key: why for key, why in self.problems.items() if _is_in(found, *key)}

    def _mark(self, changes: Changes) -> None:
        if changes.everything:
            self._varying.clear()
            self._index.tracker.mark_all(DirtyBits.ALL)
            return
        for path, bits in self._dependencies.reached_by(changes):
            self._varying.pop(path, None)
            self._index.tracker.mark(path, bits)

    def _mark_time(self, *, to_or_from_default: bool) -> None:
        """Dirty what may differ between two times; the default time has values of its own."""
        tracker = self._index.tracker
        if to_or_from_default:
            tracker.mark_all(DirtyBits.ALL & ~DirtyBits.INSTANCE_INDEX)
            return
        known = self._population
        for path in (*known.instancers, *known.cameras, *known.fields):
            if path not in self._varying:
                self._varying[path] = varying_bits(known, path)
            tracker.mark(path, self._varying[path])

    # --- answers, as `SceneDelegate` describes them ----------------------------------------

    def field(self, path: str) -> FieldSpec | None:
        """Implements `SceneDelegate.field`."""
        prim = self._population.fields[path].prim
        return self._pull("field", path, partial(read_field, prim, self.time), None)

    def crops(self, path: str) -> tuple[CropSpec, ...]:
        """Implements `SceneDelegate.crops`."""
        entry = self._population.fields[path]
        specs, problem = read_crop(entry.crop, self._code, self._xforms)
        if specs:
            self.pulls["crops"] += 1
        self._remark("crops", path, problem)
        return specs

    def placements(self, path: str) -> tuple[Placement, ...]:
        """Implements `SceneDelegate.placements`."""
        self.pulls["placements"] += 1
        return tuple(appearance.placement for appearance in self._appearances(path))

    def transforms(self, path: str) -> tuple[tuple[F64, ...], ...]:
        """Implements `SceneDelegate.transforms`."""
        self.pulls["transforms"] += 1
        found = tuple(placing.transforms(each, self._xforms) for each in self._appearances(path))
        finite = all(np.isfinite(matrix).all() for levels in found for matrix in levels)
        error = StageError(path, "a transform that is not finite", "numbers")
        self._remark("transforms", path, None if finite else error)
        return found

    def visible(self, path: str) -> tuple[bool, ...]:
        """Implements `SceneDelegate.visible`."""
        self.pulls["visible"] += 1
        return tuple(
            placing.purpose(appearance) in self._purposes
            and placing.is_visible(appearance, self._code)
            for appearance in self._appearances(path)
        )

    def instancer(self, path: str) -> InstancerSpec:
        """Implements `SceneDelegate.instancer`."""
        prim = self._population.instancers[path]
        return self._pull(
            "instancer", path, partial(read_instancer, prim, self._code), NO_INSTANCES
        )

    def camera(self, path: str) -> CameraSpec | None:
        """Implements `SceneDelegate.camera`."""
        prim = self._population.cameras[path]
        read = partial(read_camera, prim, self._code, self._xforms)
        self._remark("shutter", path, shutter_problem(prim, self._code))
        return self._pull("camera", path, read, None)

    # --- private ---------------------------------------------------------------------------

    @property
    def _code(self) -> Usd.TimeCode:
        return Usd.TimeCode.Default() if self.time is None else Usd.TimeCode(self.time)

    def _is_of_interest(self, path: str, kind: str) -> bool:
        """Arrays of what nobody sees may be broken: they are not read again until it shows."""
        return kind != "field" or self._index.fields[path].is_seen

    def _appearances(self, path: str) -> tuple[Appearance, ...]:
        return self._population.fields[path].appearances

    def _remark(self, kind: str, path: str, problem: UsdSplatError | None) -> None:
        """Note what is wrong with a prim that is used all the same, or that nothing is any more."""
        self.problems.pop((path, kind), None)
        if problem is not None:
            self.problems[path, kind] = problem

    def _pull(self, kind: str, path: str, read: Callable[[], T], unusable: T) -> T:
        """Count and read; a prim that cannot be read becomes a warning, and others go on."""
        self.pulls[kind] += 1
        before = self.problems.pop((path, kind), None)
        try:
            return read()
        except UsdSplatError as error:
            self.problems[path, kind] = error
            if str(error) != str(before):
                LOG.warning("left out: %s", error)
            return unusable


def _told(why: UsdSplatError, kind: str) -> str:
    """The sentence, and what becomes of the prim."""
    return f"{why}; it is not drawn" if kind == "field" else str(why)


def _is_in(population: Population, path: str, kind: str) -> bool:
    """Whether there is still a prim of the kind that a problem was found with."""
    prims = {
        "instancer": population.instancers,
        "camera": population.cameras,
        "shutter": population.cameras,
    }
    return path in prims.get(kind, population.fields)
