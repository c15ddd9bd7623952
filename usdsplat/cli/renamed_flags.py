"""Accept renamed flags for one version, with a hint.

Up to 0.6, `--frame` was the axes of a capture, `--time` was a frame, and only deep pictures had a
choice of compression, `--deep-compression`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from usdsplat.cli import console

_AXES = re.compile(r"[lrudfb]{3}", re.IGNORECASE)


def renamed(words: Sequence[str]) -> list[str]:
    """Return the words of a command line with old flags replaced, and print a hint for each."""
    out: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        flag, joined, value = word.partition("=")
        following = value if joined else (rest[0] if rest else "")
        new = _name(flag, following)
        if new != flag:
            console.remark(f"{flag} {following} is now {new} {following}")
        out.append(f"{new}={value}" if joined else new)
    return out


def _name(flag: str, value: str) -> str:
    """Return the current name of a flag."""
    if flag == "--deep-compression":
        return "--compression"
    if flag == "--time":
        return "--frame"
    if flag == "--frame" and _AXES.fullmatch(value):
        return "--axes"
    return flag
