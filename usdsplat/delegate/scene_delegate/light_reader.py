"""Read the lights of a stage, and keep what is expensive to read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.findings import Finding
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.domes import Skies
from usdsplat.delegate.scene_delegate.light_groups import light_group_aov
from usdsplat.delegate.scene_delegate.lights import finding_on_brightness, read_light
from usdsplat.delegate.scene_delegate.population import Population
from usdsplat.delegate.scene_delegate.unsupported import findings_on_light, is_dome
from usdsplat.render.lights.specs import LightSpec, Vector


class LightReader:
    """Lights of a stage, and findings on them."""

    def __init__(self) -> None:
        self._skies = Skies()
        self._named: dict[str, tuple[str, ...]] = {}
        """Path of a field -> paths of the lights in which it was photographed."""
        self._photographed: set[str] = set()
        self.remarks: tuple[Finding, ...] = ()
        """Findings on the light that was read last."""

    def renamed(self, known: Population) -> Iterator[tuple[str, DirtyBits]]:
        """Find the lights in which fields were photographed, which are read although they may be
        hidden. Yield the bits of those of which this has changed, and of the fields that name
        others: relationships may be forwarded, so that edits of other prims change what they name.
        """
        before, lights = self._named, self._photographed
        self._named = {path: schema.captured_lights(e.prim) for path, e in known.fields.items()}
        self._photographed = {path for named in self._named.values() for path in named}
        for path in (lights ^ self._photographed) & known.lights.keys():
            yield path, DirtyBits.PARAMS
        for path in before.keys() & self._named.keys():
            if before[path] != self._named[path]:
                yield path, DirtyBits.PRIMVAR

    def read(
        self, prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache
    ) -> LightSpec | None:
        """Read a light at a time; None if it is invisible and not that of photographs.

        Raises:
            StageError: If its numbers, its transform or its picture are invalid.
        """
        self.remarks = ()
        is_on = _is_seen(prim, time)
        if not is_on and str(prim.GetPath()) not in self._photographed:
            return None
        sky = None
        if is_dome(prim):
            sky, self.remarks = self._skies.read(prim, time)
        found = replace(
            read_light(prim, time, cache, sky), is_on=is_on, group=light_group_aov(prim)
        )
        if bright := finding_on_brightness(str(prim.GetPath()), found):
            self.remarks = (*self.remarks, bright)
        return replace(
            found,
            irradiance=_not_negative(found.irradiance),
            radiance=_not_negative(found.radiance),
        )

    def clear(self) -> None:
        """Forget the pictures of domes that were read."""
        self._skies.clear()


def unused_inputs(prims: Iterable[Usd.Prim], time: Usd.TimeCode) -> Iterator[Finding]:
    """Yield a finding for each input of a visible light that has no effect."""
    for prim in prims:
        if _is_seen(prim, time):
            yield from findings_on_light(prim)


def _not_negative(light: Vector) -> Vector:
    r, g, b = (max(each, 0.0) for each in light)
    return r, g, b


def _is_seen(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    return bool(UsdGeom.Imageable(prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible)
