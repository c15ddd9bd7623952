"""What changed since the last sync, prim by prim."""

from __future__ import annotations

from collections.abc import Iterable

from usdsplat.delegate.dirty_bits import DirtyBits


class ChangeTracker:
    """The dirty bits of every prim of one render index."""

    def __init__(self) -> None:
        self._bits: dict[str, DirtyBits] = {}
        self._carried: dict[str, tuple[str, ...]] = {}

    def insert(self, path: str, bits: DirtyBits) -> None:
        """Start to track a prim; `bits` are those it must pull before it can be used."""
        self._bits[path] = bits

    def remove(self, path: str) -> None:
        """Forget a prim."""
        self._bits.pop(path, None)
        self._carried.pop(path, None)

    def carry(self, instancer: str, paths: Iterable[str]) -> None:
        """Say which prims an instancer carries: what dirties it dirties them."""
        self._carried[instancer] = tuple(paths)

    def mark(self, path: str, bits: DirtyBits) -> None:
        """Add to a prim's dirty bits; a path that nobody tracks is ignored."""
        if path not in self._bits:
            return
        self._bits[path] |= bits
        if bits & DirtyBits.INSTANCER:
            for carried in self._carried.get(path, ()):
                self.mark(carried, DirtyBits.INSTANCER)

    def mark_all(self, bits: DirtyBits) -> None:
        """Add to every prim's dirty bits."""
        for path in self._bits:
            self._bits[path] |= bits

    def bits(self, path: str) -> DirtyBits:
        """What is dirty about a prim."""
        return self._bits.get(path, DirtyBits.CLEAN)

    def clean(self, path: str, left: DirtyBits = DirtyBits.CLEAN) -> None:
        """Say that a prim was synced; `left` is what it chose not to pull yet."""
        self._bits[path] = left
