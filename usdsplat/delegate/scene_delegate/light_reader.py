"""Read the lights of a stage, and keep what is expensive to read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Usd, UsdGeom

from usdsplat.core.findings import Finding
from usdsplat.delegate.scene_delegate.domes import Skies
from usdsplat.delegate.scene_delegate.lights import read_light
from usdsplat.delegate.scene_delegate.unsupported import findings_on_light, is_dome
from usdsplat.render.lights.specs import LightSpec


class LightReader:
    """Lights of a stage, and findings on them."""

    def __init__(self) -> None:
        self._skies = Skies()
        self.remarks: tuple[Finding, ...] = ()
        """Findings on the light that was read last."""

    def read(
        self, prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache
    ) -> LightSpec | None:
        """Read a light at a time; None if it is invisible.

        Raises:
            StageError: If its numbers, its transform or its picture are invalid.
        """
        self.remarks = ()
        if not _is_seen(prim, time):
            return None
        sky = None
        if is_dome(prim):
            sky, self.remarks = self._skies.read(prim, time)
        return read_light(prim, time, cache, sky)

    def clear(self) -> None:
        """Release all pictures."""
        self._skies.clear()


def unused_inputs(prims: Iterable[Usd.Prim], time: Usd.TimeCode) -> Iterator[Finding]:
    """Yield a finding for each input of a visible light that has no effect."""
    for prim in prims:
        if _is_seen(prim, time):
            yield from findings_on_light(prim)


def _is_seen(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    return bool(UsdGeom.Imageable(prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible)
