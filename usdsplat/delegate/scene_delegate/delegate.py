"""Provide the data of the prims of a stage at a time, and track changes."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from typing import Literal, TypeVar

import numpy as np
from pxr import Tf, Usd, UsdGeom

from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import StageError, UsageError, UsdSplatError
from usdsplat.core.findings import Finding, finding, from_error
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import NO_INSTANCES, InstancerSpec, Placement
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.delegate.render_index import RenderIndex
from usdsplat.delegate.rprim import Rprim
from usdsplat.delegate.scene_delegate import placing
from usdsplat.delegate.scene_delegate.cameras import camera_findings, read_camera
from usdsplat.delegate.scene_delegate.crops import read_crop
from usdsplat.delegate.scene_delegate.dependencies import Dependencies
from usdsplat.delegate.scene_delegate.geometry import Context
from usdsplat.delegate.scene_delegate.instancers import read_instancer
from usdsplat.delegate.scene_delegate.light_reader import LightReader, unused_inputs
from usdsplat.delegate.scene_delegate.live_fields import LiveFields
from usdsplat.delegate.scene_delegate.lod_items import LodItems
from usdsplat.delegate.scene_delegate.meshes import MeshReader
from usdsplat.delegate.scene_delegate.notices import Changes, NoticeListener
from usdsplat.delegate.scene_delegate.points import is_points
from usdsplat.delegate.scene_delegate.population import Appearance, Population, populate
from usdsplat.delegate.scene_delegate.problem_kinds import UNREADABLE
from usdsplat.delegate.scene_delegate.readings import Readings, Sources
from usdsplat.delegate.scene_delegate.reconcile import reconcile
from usdsplat.delegate.scene_delegate.skeletons import Skeletons
from usdsplat.delegate.scene_delegate.stage_info import first_frame, read_stage_info
from usdsplat.delegate.scene_delegate.textures import Textures
from usdsplat.delegate.scene_delegate.trees import Chunks
from usdsplat.delegate.scene_delegate.unsupported import findings_on_prims, in_order
from usdsplat.delegate.scene_delegate.variability import varying_bits
from usdsplat.delegate.stage_info import StageInfo
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.specs import CameraSpec, CropSpec, FieldSpec, MeshSpec, View
from usdsplat.schema.stage_values import metadata_problems, up_axis
from usdsplat.schema.validation import errors_of_drawn

T = TypeVar("T")

LOG = logging.getLogger("usdsplat")
"""Logs each prim that is not drawn once, for Python users; commands print it too."""

NOWHERE: F64 = np.full((4, 4), np.nan)
"""Transform of an appearance that cannot be placed; it is not drawn."""


class UsdSceneDelegate:
    """A `SceneDelegate` that reads a Usd.Stage and keeps a render index up to date.

    Edits are collected as they arrive; `apply_pending_updates` turns them into dirty bits.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        index: RenderIndex,
        *,
        time: float | Literal["first"] | None,
        purposes: Iterable[str],
        refinement: int,
    ) -> None:
        self.stage = stage
        self.pulls: Counter[str] = Counter()
        """Number of reads so far, by kind."""
        self.time = first_frame(stage) if time == "first" else time
        self._applied_time = self.time
        self._purposes = frozenset(purposes)
        self._index = index
        self._population = Population()
        self._dependencies = Dependencies(self._population)
        self._refinement = _checked_refinement(refinement)
        self._textures = Textures()
        self._lights = LightReader()
        self._skeletons = Skeletons()
        self._readings = Readings(stage)
        self._chunks = Chunks()
        self._live = LiveFields()
        self._meshes: dict[str, MeshReader] = {}
        self._said: set[str] = set()
        self._varying: dict[str, DirtyBits] = {}
        self.problems: dict[tuple[str, str], UsdSplatError] = {}
        """(path, kind) of data that could not be read -> error."""
        self._remarks: dict[tuple[str, str], tuple[Finding, ...]] = {}
        self._xforms = UsdGeom.XformCache(self._code)
        self._rate = stage.GetTimeCodesPerSecond()
        self._lod = LodItems(stage)
        self._is_stale = True
        self._notices = NoticeListener(stage)

    @property
    def up_axis(self) -> str:
        """The stage's upAxis, "Y" or "Z"; "Y" if it is neither."""
        return up_axis(self.stage)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the stage asks for and does not get at this time, by path."""
        found = list(self._population.findings)
        found += [from_error(code, wrong) for code, wrong in metadata_problems(self.stage)]
        for (path, kind), why in self.problems.items():
            if self._is_of_interest(path, kind):
                found.append(from_error(UNREADABLE[kind], why))
        for (path, kind), each in self._remarks.items():
            if kind in ("lens", "light") or self._rprim(path).is_wanted:
                found += each
        for path, reader in self._meshes.items():
            if self._is_of_interest(path, "mesh") and (path, "mesh") not in self.problems:
                found += reader.findings
        for path, problems in self._index.tree_problems():
            prim = self._population.fields[path].prim
            found += self._chunks.findings(path, prim, problems)
        found += findings_on_prims(self._population.others, self._code, self._purposes)
        found += unused_inputs(self._population.lights.values(), self._code)
        return in_order(found)

    def set_time(self, time: float | None) -> None:
        """Set the time of the next update."""
        self.time = time

    def set_purposes(self, purposes: Iterable[str]) -> None:
        """Set the drawn purposes from the next sync on."""
        wanted = frozenset(purposes)
        if wanted != self._purposes:
            self._purposes = wanted
            self._index.tracker.mark_all(DirtyBits.RENDER_TAG)

    def set_refinement(self, levels: int) -> None:
        """Set the refinement level of subdivision surfaces from the next sync on."""
        levels = _checked_refinement(levels)
        if levels != self._refinement:
            self._refinement = levels
            for path in self._population.meshes:
                self._index.tracker.mark(path, DirtyBits.DISPLAY_STYLE)

    def update_chunk(self, path: str, node: int, cloud: SplatCloud | None) -> None:
        """Implement `Engine.update_chunk`."""
        self.apply_pending_updates()
        self._chunks.update(path, self._population.fields.get(path), node, cloud)
        self._index.tracker.mark(path, DirtyBits.PRIMVAR)

    def show_live(self, live: LiveClouds | None) -> None:
        """Implement `Engine.show_live`."""
        self._live.live = live

    def close(self) -> None:
        """Stop listening and release every prim."""
        self._notices.close()
        self._chunks.close()
        self._population = Population()
        self._xforms.Clear()
        self._skeletons.clear()
        self._textures.clear()
        self._lights.clear()
        self._meshes.clear()

    # --- changes -----------------------------------------------------------------------------

    def apply_pending_updates(self, view: View | None = None) -> None:
        """Bring the index's prims and their dirty bits up to date with the stage and the time.

        Of LOD roots, the items that a view shows are drawn; None keeps those of the last view.
        """
        changes = self._notices.take()
        self._is_stale |= changes.structural
        self._is_stale |= changes.inherited and bool(self.stage.GetPrototypes())
        rate = self.stage.GetTimeCodesPerSecond()
        changes.everything |= rate != self._rate  # muting a layer changes it without a notice
        if changes:
            self._skeletons.clear()
        self._mark(changes)
        self._rate = rate
        changed, stale = bool(changes), self._is_stale
        if self._lod.choose(view, self._code, changed=changed, structural=stale):
            self._is_stale = True
            self._index.tracker.mark_all(DirtyBits.VISIBILITY)
        if self._is_stale:
            self._populate()
            self._is_stale = False
        if changed or stale:
            for path, bits in self._lights.renamed(self._population):
                self._index.tracker.mark(path, bits)
        edited = changed or self.time != self._applied_time
        for path in self._chunks.changed_trees(self._population.fields, self._code, edited=edited):
            self._index.tracker.mark(path, DirtyBits.PRIMVAR)
        if self.time != self._applied_time:
            self._mark_time(to_or_from_default=None in (self.time, self._applied_time))
            self._applied_time = self.time
        for path in self._live.changed(self.time):
            self._index.tracker.mark(path, DirtyBits.PRIMVAR)
        self._xforms = UsdGeom.XformCache(self._code)

    def _populate(self) -> None:
        found = populate(self.stage, self._lod.choice)
        reconcile(self._index, self._population, found)
        for path in self._population.meshes.keys() - found.meshes.keys():
            self._meshes.pop(path, None)  # meshes that were never visible have no reader
            self._readings.remove(path)
        self._population = found
        self._chunks.keep(found.fields.keys())
        self._dependencies = Dependencies(found)
        self._varying.clear()
        self._readings.refresh()
        self.problems = {key: why for key, why in self.problems.items() if found.has(*key)}
        self._remarks = {key: why for key, why in self._remarks.items() if found.has(*key)}

    def _mark(self, changes: Changes) -> None:
        if changes.everything:
            self._varying.clear()
            self._index.tracker.mark_all(DirtyBits.ALL)
            return
        for path, bits in (
            *self._dependencies.reached_by(changes),
            *self._readings.reached_by(changes),
        ):
            self._varying.pop(path, None)
            self._index.tracker.mark(path, bits)

    def _mark_time(self, *, to_or_from_default: bool) -> None:
        """Mark what may differ between two times; the default time has separate values."""
        tracker = self._index.tracker
        if to_or_from_default:
            tracker.mark_all(DirtyBits.ALL & ~DirtyBits.INSTANCE_INDEX)
            return
        known = self._population
        rprims = (path for path, _ in known.rprims())
        for path in (*known.instancers, *known.cameras, *known.lights, *rprims):
            if path not in self._varying:
                self._varying[path] = varying_bits(known, self._readings, path)
            tracker.mark(path, self._varying[path])

    # --- implementation of `SceneDelegate` ------------------------------------------------

    def stage_info(self) -> StageInfo:
        """Return the values of the stage that headers of pictures contain."""
        entries = (entry for _, entry in self._population.rprims())
        placed = (seen.placement for entry in entries for seen in entry.appearances)
        known = self._population
        clipped = known.clipped.of(self.stage)
        return read_stage_info(self.stage, placed, known.lights.values(), clipped)

    def field(self, path: str) -> FieldSpec | None:
        """Implement `SceneDelegate.field`."""
        prim = self._population.fields[path].prim
        spec = self._pull("field", path, partial(self._live.read, path, prim, self.time), None)
        is_read = spec is not None and self._live.cloud(path) is None and not is_points(prim)
        self._remark("values", path, *(errors_of_drawn(prim, self.time) if is_read else ()))
        return spec

    def tree(self, path: str, bits: DirtyBits) -> TreeSpec | None:
        """Implement `SceneDelegate.tree`."""
        read = partial(self._chunks.read, path, self._population.fields[path].prim, bits, self.time)
        return self._pull("tree", path, read, None)

    def mesh(self, path: str, bits: DirtyBits) -> MeshSpec | None:
        """Implement `SceneDelegate.mesh`."""
        prim = self._population.meshes[path].prim
        if path not in self._meshes:
            self._meshes[path] = MeshReader(path, self._textures, self._readings)
        reader = self._meshes[path]
        context = Context(
            time=self._code,
            levels=self._refinement,
            skeletons=self._skeletons,
            pulls=self.pulls,
        )
        spec = self._pull("mesh", path, partial(reader.read, prim, bits, context), None)
        if reader.has_other_sources:
            self._varying.pop(path, None)
        for each in reader.findings if spec else ():
            if each.severity != "note" and each.message not in self._said:
                self._said.add(each.message)
                LOG.warning("%s", each.message)
        return spec

    def crops(self, path: str) -> tuple[CropSpec, ...]:
        """Implement `SceneDelegate.crops`."""
        entry = self._population.fields[path]
        specs, findings = read_crop(entry.crop, self._code, self._xforms)
        if specs:
            self.pulls["crops"] += 1
        self._remark("crops", path, *findings)
        return specs

    def placements(self, path: str) -> tuple[Placement, ...]:
        """Implement `SceneDelegate.placements`."""
        self.pulls["placements"] += 1
        return tuple(appearance.placement for appearance in self._appearances(path))

    def transforms(self, path: str) -> tuple[tuple[F64, ...], ...]:
        """Implement `SceneDelegate.transforms`."""
        self.pulls["transforms"] += 1
        sources = Sources(self.stage, DirtyBits.TRANSFORM)
        is_mesh = path in self._population.meshes
        wrong: list[Finding] = []
        found: list[tuple[F64, ...]] = []
        for each in self._appearances(path):
            frame = each.levels[-1].prim
            try:
                frame = self._skeletons.frame(frame, sources=sources) if is_mesh else frame
                found.append(placing.transforms(each, frame, self._xforms))
            except StageError as error:
                wrong = [from_error("bad-transform", error)]
                found.append((NOWHERE,) * len(each.levels))
        if is_mesh and self._readings.put(path, "transforms", sources):
            self._varying.pop(path, None)
        finite = all(np.isfinite(matrix).all() for levels in found for matrix in levels)
        if not wrong and not finite:
            wrong = [finding("bad-transform", path, "a transform that is not finite", "numbers")]
        self._remark("transforms", path, *wrong)
        return tuple(found)

    def visible(self, path: str) -> tuple[bool, ...]:
        """Implement `SceneDelegate.visible`."""
        self.pulls["visible"] += 1
        return tuple(
            placing.purpose(appearance) in self._purposes
            and placing.is_visible(appearance, self._code, self._lod.choice.shown)
            for appearance in self._appearances(path)
        )

    def instancer(self, path: str) -> InstancerSpec:
        """Implement `SceneDelegate.instancer`."""
        prim = self._population.instancers[path]
        return self._pull(
            "instancer", path, partial(read_instancer, prim, self._code), NO_INSTANCES
        )

    def camera(self, path: str) -> CameraSpec | None:
        """Implement `SceneDelegate.camera`."""
        prim = self._population.cameras[path]
        read = partial(read_camera, prim, self._code, self._xforms)
        self._remark("lens", path, *camera_findings(prim, self._code))
        return self._pull("camera", path, read, None)

    def light(self, path: str) -> LightSpec | None:
        """Implement `SceneDelegate.light`."""
        read = partial(self._lights.read, self._population.lights[path], self._code, self._xforms)
        spec = self._pull("light", path, read, None)
        self._remark("light", path, *self._lights.remarks)
        return spec

    # --- private ---------------------------------------------------------------------------

    @property
    def _code(self) -> Usd.TimeCode:
        return Usd.TimeCode.Default() if self.time is None else Usd.TimeCode(self.time)

    def _is_of_interest(self, path: str, kind: str) -> bool:
        """Return whether to report a problem: arrays of invisible prims are not read and may be
        broken."""
        return kind not in ("mesh", "field") or self._rprim(path).is_seen

    def _rprim(self, path: str) -> Rprim:
        fields = self._index.fields
        return fields[path] if path in fields else self._index.meshes[path]

    def _appearances(self, path: str) -> tuple[Appearance, ...]:
        known = self._population
        return (known.fields if path in known.fields else known.meshes)[path].appearances

    def _remark(self, kind: str, path: str, *findings: Finding) -> None:
        """Replace the findings of a kind about a prim that is used nevertheless."""
        self._remarks.pop((path, kind), None)
        if findings:
            self._remarks[path, kind] = findings

    def _pull(self, kind: str, path: str, read: Callable[[], T], unusable: T) -> T:
        """Read a prim and count it; if it fails, record a problem and return `unusable`."""
        self.pulls[kind] += 1
        before = self.problems.pop((path, kind), None)
        try:
            return read()
        except UsdSplatError as error:
            why = error
        except Tf.ErrorException:  # USD's own checks, such as those of joint influences
            why = StageError(path, "values that do not fit together", "compatible values")
        self.problems[path, kind] = why
        if str(why) != str(before):
            LOG.warning("left out: %s", why)
        return unusable


def _checked_refinement(levels: int) -> int:
    if levels not in range(6):
        raise UsageError("refinement", str(levels), "a whole number from 0 to 5")
    return levels
