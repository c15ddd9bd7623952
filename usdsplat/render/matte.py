"""Which prims hold out of a picture."""

from __future__ import annotations


def is_matte(path: str, rules: tuple[tuple[str, bool], ...]) -> bool:
    """Whether the prim at `path` is matte: the longest of the rules' paths that it is at or beneath
    decides, and of equal ones the last. With none it is not."""
    longest, matte = -1, False
    for prefix, rule in rules:
        beneath = prefix.rstrip("/") + "/"
        if (path == prefix or path.startswith(beneath)) and len(beneath) >= longest:
            longest, matte = len(beneath), rule
    return matte
