"""Track the changes of prims since the last sync."""

from __future__ import annotations

from collections.abc import Iterable

from usdsplat.delegate.dirty_bits import DirtyBits


class ChangeTracker:
    """The dirty bits of all prims of a render index."""

    def __init__(self) -> None:
        self._bits: dict[str, DirtyBits] = {}
        self._carried: dict[str, tuple[str, ...]] = {}

    def insert(self, path: str, bits: DirtyBits) -> None:
        """Track a prim; `bits` are those it must pull before it can be used."""
        self._bits[path] = bits

    def remove(self, path: str) -> None:
        """Stop tracking a prim."""
        self._bits.pop(path, None)
        self._carried.pop(path, None)

    def carry(self, instancer: str, paths: Iterable[str]) -> None:
        """Set the prims that an instancer carries: they become dirty with it."""
        self._carried[instancer] = tuple(paths)

    def mark(self, path: str, bits: DirtyBits) -> None:
        """Add dirty bits to a prim; untracked paths are ignored."""
        if path not in self._bits:
            return
        self._bits[path] |= bits
        if bits & DirtyBits.INSTANCER:
            for carried in self._carried.get(path, ()):
                self.mark(carried, DirtyBits.INSTANCER)

    def mark_all(self, bits: DirtyBits) -> None:
        """Add dirty bits to every prim."""
        for path in self._bits:
            self._bits[path] |= bits

    def bits(self, path: str) -> DirtyBits:
        """Return the dirty bits of a prim."""
        return self._bits.get(path, DirtyBits.CLEAN)

    def clean(self, path: str, left: DirtyBits = DirtyBits.CLEAN) -> None:
        """Mark a prim as synced; `left` are the bits that it did not pull."""
        self._bits[path] = left
