"""What a window shows, and how to open it again in another way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdsplat.preview.document import Document
from usdsplat.preview.values import Event

Opener = Callable[..., Document]
"""Opens a document in the session's thread; called with `publish`, and with `axes` and `device` as
`open_document` takes them if a user chose them in the window."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Source:
    """A document that can be opened."""

    opener: Opener
    path: Path | None = None
    """Its file; None if it has none."""
    axes: str | None = None
    """Axes of a capture that was turned in the window; None for those of the opener."""
    device: str | None = None
    """Device that was chosen in the window; None for that of the opener."""
    is_same_scene: bool = False
    """Whether it shows the scene that is open now, so that camera and bookmarks are kept."""

    @property
    def name(self) -> str:
        """Name of its file; "" if it has none."""
        return "" if self.path is None else self.path.name

    def open(self, publish: Callable[[Event], None]) -> Document:
        """Open it; errors are the opener's."""
        chosen: dict[str, Any] = {"axes": self.axes, "device": self.device}
        given = {name: value for name, value in chosen.items() if value is not None}
        return self.opener(publish=publish, **given)
