"""Fields whose splats are drawn from a value instead of the stage."""

from __future__ import annotations

from pxr import Usd

from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.delegate.scene_delegate.fields import read_cloud, read_field
from usdsplat.render.specs import FieldSpec


class LiveFields:
    """The live clouds of an engine, and which fields show them."""

    def __init__(self) -> None:
        self.live: LiveClouds | None = None
        self._shown: LiveClouds | None = None

    def changed(self, time: float | None) -> frozenset[str]:
        """Return the fields that are to be read again because the value or the time changed."""
        before, live = self._shown, self.live
        self._shown = live if live is not None and live.time == time else None
        if before is self._shown:
            return frozenset()
        return frozenset(path for each in (before, self._shown) if each for path in each.clouds)

    def cloud(self, path: str) -> SplatCloud | None:
        """Return the splats of a field at this time; None if those of the stage count."""
        return None if self._shown is None else self._shown.clouds.get(path)

    def read(self, path: str, prim: Usd.Prim, time: float | None) -> FieldSpec | None:
        """Read a field as `read_field` does, with the live splats if there are some."""
        cloud = self.cloud(path)
        if cloud is None or self._shown is None:
            return read_field(prim, time)
        return read_cloud(prim, time, cloud, moves=path in self._shown.moving)
