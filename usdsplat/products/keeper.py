"""Keep the stage of one task open for the next one."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from usdsplat.core.findings import Finding
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.scene_delegate import Stage


@dataclass(frozen=True, slots=True, eq=False)
class OpenStage:
    """An engine, its stage, and the findings of opening its stage."""

    engine: Engine
    stage: Stage
    findings: tuple[Finding, ...] = ()
    files: tuple[str, ...] = ()
    """Files that the engine does not name: those of a capture."""


class EngineKeeper:
    """Owner of at most one open engine, which tasks on the same stage use one after the other.

    The engine is opened anew if a file of its stage has changed.
    """

    def __init__(self) -> None:
        self._key: Hashable = None
        self._open: OpenStage | None = None
        self._versions: dict[str, tuple[int, int] | None] = {}

    @contextmanager
    def opened(self, key: Hashable, make: Callable[[], OpenStage]) -> Iterator[OpenStage]:
        """Yield the open stage of a key; `make` opens it if it is not open.

        It stays open after the context, unless the context ends with an error.
        """
        if self._open is None or key != self._key or self._versions != _versions(self._open):
            self.close()
            self._open, self._key = make(), key
            self._versions = _versions(self._open)
        try:
            yield self._open
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the engine, if there is one."""
        found, self._open = self._open, None
        if found is not None:
            found.engine.close()


def _versions(opened: OpenStage) -> dict[str, tuple[int, int] | None]:
    """Return size and time of each file of a stage; None for a file that cannot be read."""
    found: dict[str, tuple[int, int] | None] = {}
    info = opened.engine.stage_info()
    for path in (*info.files, *info.clips, *opened.files):
        try:
            status = os.stat(path)
            found[path] = status.st_size, status.st_mtime_ns
        except OSError:
            found[path] = None
    return found
