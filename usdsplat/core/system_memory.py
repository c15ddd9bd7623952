"""Memory as Linux reports it: of the machine, and of the control group of this process.

Containers and schedulers such as Slurm limit the memory of a control group, while `/proc/meminfo`
is that of the whole machine. Source: Linux kernel documentation, "Control Group v2" and "Memory
Resource Controller" (version 1).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

_V2 = ("memory.max", "memory.current", "inactive_file")
_V1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
"""Files with limit and usage of a group, and the part of the usage that is reclaimed first."""


def free(root: Path = Path("/")) -> int:
    """Return the bytes available without swapping; 0 if the system does not report them.

    Args:
        root: Folder of the system's `proc` and `sys`.
    """
    available = reported(root / "proc/meminfo", "MemAvailable")
    if not available:
        return 0
    return max(1, min([available, *_left_in_groups(root)]))


def reported(file: Path, name: str) -> int:
    """Return a size that Linux reports in kibibytes, in bytes; 0 if it is not reported."""
    line = next((line for line in _text(file).splitlines() if line.startswith(name)), "none: 0")
    return 1024 * int(line.split()[1])


def _left_in_groups(root: Path) -> Iterator[int]:
    """Yield what is left to each group with a limit that this process is in [byte]."""
    for line in _text(root / "proc/self/cgroup").splitlines():
        number, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if number == "0":
            top, names = root / "sys/fs/cgroup", _V2
        elif "memory" in controllers.split(","):
            top, names = root / "sys/fs/cgroup/memory", _V1
        else:
            continue
        group = Path(path.lstrip("/"))
        for each in (group, *group.parents):
            yield from _left(top / each, *names)


def _left(group: Path, limit: str, usage: str, cache: str) -> Iterator[int]:
    most, used = _text(group / limit).strip(), _text(group / usage).strip()
    if most.isdecimal() and used.isdecimal():
        stat = (line.split() for line in _text(group / "memory.stat").splitlines())
        cached = next((int(words[1]) for words in stat if words[0] == cache), 0)
        yield int(most) - int(used) + cached


def _text(file: Path) -> str:
    """Return the text of a file; "" if it cannot be read."""
    try:
        return file.read_text()
    except OSError:
        return ""
