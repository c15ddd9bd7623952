"""Collect USD's change notices.

`Usd.Notice.ObjectsChanged` names prims and properties; for instances it names the paths inside
their prototypes, which `Dependencies` maps.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

from pxr import Sdf, Tf, Usd

from usdsplat.delegate.scene_delegate.bindings import BINDING
from usdsplat.delegate.scene_delegate.names import DRAWING, KNOWN
from usdsplat.schema.tokens import LOD_ROOT

COLOR_SPACE = "colorSpace"
ASSET_FIELDS = ("kind", "assetInfo")
"""Metadata from which the asset of a prim follows."""
GRADE = "splat:grade:"
"""Prefix of properties that fields inherit from their ancestors."""
INHERITED = (BINDING, "primvars:", "skel:")
"""Prefixes of properties that meshes inherit from their ancestors."""


@dataclass(slots=True)
class Changes:
    """Changes since the last `take`."""

    resynced: set[Sdf.Path] = field(default_factory=set)
    """Prims that must be read again, with their descendants."""
    properties: set[Sdf.Path] = field(default_factory=set)
    prims: set[Sdf.Path] = field(default_factory=set)
    """Prims, and the stage itself, whose metadata changed without a resync."""
    structural: bool = False
    """Whether the set of prims or placements may have changed."""
    inherited: bool = False
    """Whether inherited values may have changed, which distinguish instances."""
    everything: bool = False

    def __bool__(self) -> bool:
        return bool(self.resynced or self.properties or self.prims or self.everything)


class NoticeListener:
    """Listener that collects the changes of a stage, in any thread that edits it.

    USD forbids edits while another thread reads the stage, such as one that syncs.

    The callback only records changes, so that many edits cost one update.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self._lock = threading.Lock()
        self._changes = Changes()
        self._key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._collect, stage)

    def take(self) -> Changes:
        """Return the collected changes and start over."""
        with self._lock:
            changes, self._changes = self._changes, Changes()
        return changes

    def close(self) -> None:
        """Stop listening."""
        self._key.Revoke()

    def _collect(self, notice: Usd.Notice.ObjectsChanged, sender: Any) -> None:
        with self._lock:
            for path in notice.GetResyncedPaths():
                if path.IsAbsoluteRootOrPrimPath():
                    self._resync(path)
                else:
                    self._change_property(path, new=True)
            for path in notice.GetChangedInfoOnlyPaths():
                fields = set(notice.GetChangedFields(path))
                if path.IsAbsoluteRootOrPrimPath():
                    self._changes.prims.add(path)
                    self._changes.structural |= not fields.isdisjoint(ASSET_FIELDS)
                else:
                    self._change_property(path, new=COLOR_SPACE in fields)

    def _resync(self, path: Sdf.Path) -> None:
        self._changes.resynced.add(path)
        self._changes.structural = True
        self._changes.everything |= path == Sdf.Path.absoluteRootPath

    def _change_property(self, path: Sdf.Path, *, new: bool) -> None:
        """Record a changed property; `new` if it or its metadata may not have existed before."""
        self._changes.properties.add(path)
        colored = path.name.startswith("radiance:") and new
        self._changes.inherited |= new and path.name.startswith(INHERITED)
        regrouped = path.name == "prototypes" or path.name.startswith("collection:")
        misspelt = new and path.name.startswith(DRAWING) and path.name not in KNOWN
        regrouped |= path.name.startswith(BINDING) or path.name == LOD_ROOT
        graded = new and path.name.startswith(GRADE)  # it may be a field's, or have no effect
        self._changes.structural |= (
            graded or regrouped or is_color_space(path.name) or colored or misspelt
        )


def is_color_space(name: str) -> bool:
    """Return whether a property names or defines a colour space."""
    return name.startswith(COLOR_SPACE)
