"""Record the sources of meshes: materials, shaders, skeletons, animations, subsets.

The sources are known only after relationships are followed, so each reading records them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from pxr import Sdf, Usd

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.notices import Changes
from usdsplat.delegate.scene_delegate.population import source_of


class Sources:
    """The prims that a value was read from, including missing ones that were looked for."""

    def __init__(self, stage: Usd.Stage, bits: DirtyBits) -> None:
        self.bits = bits
        """Bits that are dirty if one of them changes."""
        self.read: set[Sdf.Path] = set()
        """Prims whose properties were read."""
        self.placed: set[Sdf.Path] = set()
        """Prims whose transform only was read."""
        self._stage = stage

    def add(self, prim: Usd.Prim) -> None:
        """Record a prim whose properties are read."""
        self.read.add(prim.GetPath())

    def follow(self, path: Sdf.Path) -> Usd.Prim:
        """Record the prim of `path` and return it; it may be invalid."""
        self.read.add(path.GetPrimPath())
        return self._stage.GetPrimAtPath(path.GetPrimPath())

    def targets(self, prim: Usd.Prim, name: str) -> list[Sdf.Path]:
        """Return the forwarded targets of a relationship and record them."""
        relationship = prim.GetRelationship(name)
        found = relationship.GetForwardedTargets() if relationship else []
        for path in found:
            self.follow(path)
        return list(found)

    def place(self, prim: Usd.Prim) -> None:
        """Record a prim whose transform, including its ancestors', is read."""
        self.placed.update(prim.GetPath().GetPrefixes())


class Readings:
    """The sources of every mesh, indexed by path."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self._sources: dict[str, dict[str, Sources]] = defaultdict(dict)
        self._read: dict[Sdf.Path, set[tuple[str, str]]] = defaultdict(set)
        self._placed: dict[Sdf.Path, set[tuple[str, str]]] = defaultdict(set)
        self._beneath: dict[Sdf.Path, set[tuple[str, str]]] = defaultdict(set)
        self._twins: dict[Sdf.Path, Sdf.Path] = {}

    def put(self, path: str, aspect: str, sources: Sources) -> bool:
        """Set the sources of an aspect of the mesh at `path`.

        Returns:
            Whether they differ from before.
        """
        before = self._sources[path].get(aspect)
        if before and (before.read, before.placed) == (sources.read, sources.placed):
            return False
        self._drop(path, aspect)
        self._sources[path][aspect] = sources
        self._enter(path, aspect, sources)
        return True

    def remove(self, path: str) -> None:
        """Remove a mesh."""
        for aspect in self._sources.get(path, {}):
            self._drop(path, aspect)
        self._sources.pop(path, None)

    def refresh(self) -> None:
        """Update the mapping of instance proxies to prims in prototypes."""
        for index in (self._read, self._placed, self._beneath, self._twins):
            index.clear()
        for path, aspects in self._sources.items():
            for aspect, sources in aspects.items():
                self._enter(path, aspect, sources)

    def reached_by(self, changes: Changes) -> Iterator[tuple[str, DirtyBits]]:
        """Yield (mesh path, dirty bits) for `changes`."""
        for path in changes.resynced:
            yield from self._marked(self._beneath.get(path))
        for path in changes.properties:
            prim = path.GetPrimPath()
            if path.name.startswith("xformOp"):
                for mesh, _ in self._placed.get(prim, ()):
                    yield mesh, DirtyBits.TRANSFORM
            else:
                yield from self._marked(self._read.get(prim))

    def sources(self, path: str) -> Iterator[Sources]:
        """Yield the sources of the mesh at `path`, aspect by aspect."""
        yield from self._sources.get(path, {}).values()

    # --- private ---------------------------------------------------------------------------

    def _marked(self, keys: set[tuple[str, str]] | None) -> Iterator[tuple[str, DirtyBits]]:
        for path, aspect in keys or ():
            yield path, self._sources[path][aspect].bits

    def _enter(self, path: str, aspect: str, sources: Sources) -> None:
        for keys in self._keys(sources):
            keys.add((path, aspect))

    def _drop(self, path: str, aspect: str) -> None:
        sources = self._sources.get(path, {}).get(aspect)
        if sources is not None:
            for keys in self._keys(sources):
                keys.discard((path, aspect))

    def _keys(self, sources: Sources) -> Iterator[set[tuple[str, str]]]:
        """Yield the index sets of all paths in `sources`."""
        for index, found in ((self._read, sources.read), (self._placed, sources.placed)):
            for each in found:
                for twin in {each, self._twin(each)}:
                    yield index[twin]
                    yield from (self._beneath[prefix] for prefix in twin.GetPrefixes())

    def _twin(self, path: Sdf.Path) -> Sdf.Path:
        """Return the path of the prototype's prim for an instance proxy, or `path`."""
        if path not in self._twins:
            prim = self._stage.GetPrimAtPath(path)
            self._twins[path] = source_of(prim).GetPath() if prim else path
        return self._twins[path]
