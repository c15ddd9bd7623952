"""Named views."""

from __future__ import annotations

from dataclasses import dataclass, replace

from usdsplat.preview.camera import FreeCamera


@dataclass(frozen=True, slots=True, kw_only=True)
class Bookmark:
    """A named view."""

    name: str
    camera: FreeCamera | str | None
    """As in a `ViewState`."""
    time: float | None


def without(bookmarks: tuple[Bookmark, ...], name: str) -> tuple[Bookmark, ...]:
    """Return the bookmarks without the one of a name."""
    return tuple(each for each in bookmarks if each.name != name)


def renamed(bookmarks: tuple[Bookmark, ...], name: str, to: str) -> tuple[Bookmark, ...]:
    """Return the bookmarks with another name for one, which replaces any of that name."""
    if not to.strip() or to == name:
        return bookmarks
    return tuple(
        replace(each, name=to) if each.name == name else each for each in without(bookmarks, to)
    )


def free_name(bookmarks: tuple[Bookmark, ...]) -> str:
    """Return an unused name."""
    taken = {each.name for each in bookmarks}
    numbered = (f"View {number}" for number in range(1, len(taken) + 2))
    return next(name for name in numbered if name not in taken)
