"""Find which prims are mattes."""

from __future__ import annotations


def is_matte(path: str, rules: tuple[tuple[str, bool], ...]) -> bool:
    """Return whether the prim at `path` is a matte.

    The rule with the longest path at or above the prim decides; of equal paths, the last. Without a
    rule it is not a matte.
    """
    longest, matte = -1, False
    for prefix, rule in rules:
        beneath = prefix.rstrip("/") + "/"
        if (path == prefix or path.startswith(beneath)) and len(beneath) >= longest:
            longest, matte = len(beneath), rule
    return matte
