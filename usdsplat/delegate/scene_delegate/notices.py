"""Collect what USD says has changed, and say what it means.

`Usd.Notice.ObjectsChanged` speaks of prims and properties; of instances it names the paths inside
their prototypes, which `Dependencies` knows.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

from pxr import Sdf, Tf, Usd

COLOR_SPACE = "colorSpace"
INHERITED = ("material:binding", "primvars:", "skel:")
"""How properties begin that meshes inherit from the prims above them."""


@dataclass(slots=True)
class Changes:
    """What happened since somebody last looked."""

    resynced: set[Sdf.Path] = field(default_factory=set)
    """Prims that must be looked at anew, and all beneath them."""
    properties: set[Sdf.Path] = field(default_factory=set)
    prims: set[Sdf.Path] = field(default_factory=set)
    """Prims, and the stage itself, of which some metadata changed that resyncs nothing."""
    structural: bool = False
    """Whether there may be other prims, or other ways to see them, than before."""
    inherited: bool = False
    """Whether prims may pass on other things than before, which sets instances apart."""
    everything: bool = False

    def __bool__(self) -> bool:
        return bool(self.resynced or self.properties or self.prims or self.everything)


class NoticeListener:
    """Listens to one stage and collects, in whichever thread the stage is edited. (USD itself
    forbids edits while another thread, such as one that syncs, reads the stage.)

    The callback only takes notes, so that a burst of edits costs one update.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self._lock = threading.Lock()
        self._changes = Changes()
        self._key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._collect, stage)

    def take(self) -> Changes:
        """Return what was collected and start over."""
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
                else:
                    self._change_property(path, new=COLOR_SPACE in fields)

    def _resync(self, path: Sdf.Path) -> None:
        self._changes.resynced.add(path)
        self._changes.structural = True
        self._changes.everything |= path == Sdf.Path.absoluteRootPath

    def _change_property(self, path: Sdf.Path, *, new: bool) -> None:
        """`new` when there may be an attribute, or metadata of it, that was not there before."""
        self._changes.properties.add(path)
        colored = path.name.startswith("radiance:") and new
        self._changes.inherited |= new and path.name.startswith(INHERITED)
        regrouped = path.name == "prototypes" or path.name.startswith("collection:")
        self._changes.structural |= regrouped or is_color_space(path.name) or colored


def is_color_space(name: str) -> bool:
    """Whether a property is part of what names or defines a colour space."""
    return name.startswith(COLOR_SPACE)
