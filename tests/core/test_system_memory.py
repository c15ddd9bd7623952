"""Tests of the memory that is free for a process."""

from __future__ import annotations

import pytest

from usdsplat.core.system_memory import free

GIB = 1 << 30


def system(root, groups, **files):
    """Write files of a system with 64 GiB available."""
    files = {"proc/meminfo": f"MemTotal: 99 kB\nMemAvailable: {64 << 20} kB\n", **files}
    for name, text in {**files, "proc/self/cgroup": groups}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(str(text))
    return root


def test_a_machine_without_limits_has_what_is_available(tmp_path):
    """Oracle: by hand; a limit "max" is none."""
    top = "sys/fs/cgroup/"
    files = {f"{top}memory.max": "max\n", f"{top}memory.current": GIB}
    assert free(system(tmp_path, "0::/\n", **files)) == 64 * GIB
    assert free(tmp_path / "elsewhere") == 0


@pytest.mark.parametrize("inner", ["", "job_1/", "job_1/step_0/"])
def test_the_limit_of_a_group_or_one_above_holds(tmp_path, inner):
    """Oracle: by hand: 8 GiB of which 3 are used, one of them by a cache of files."""
    top = f"sys/fs/cgroup/{inner}"
    files = {
        f"{top}memory.max": f"{8 * GIB}\n",
        f"{top}memory.current": f"{3 * GIB}\n",
        f"{top}memory.stat": f"anon {2 * GIB}\ninactive_file {GIB}\n",
    }
    assert free(system(tmp_path, "0::/job_1/step_0\n", **files)) == 6 * GIB


def test_the_limit_of_a_group_of_version_1_holds(tmp_path):
    """Oracle: by hand; a container has its own group at the top of what it sees."""
    top = "sys/fs/cgroup/memory/"
    files = {
        f"{top}memory.limit_in_bytes": 8 * GIB,
        f"{top}memory.usage_in_bytes": 3 * GIB,
        f"{top}memory.stat": f"inactive_file 7\ntotal_inactive_file {GIB}\n",
    }
    groups = "3:cpu,cpuacct:/x\n2:memory:/docker/1\n"
    assert free(system(tmp_path, groups, **files)) == 6 * GIB


def test_a_full_group_is_not_one_that_says_nothing(tmp_path):
    """Oracle: by hand: 0 would mean that nothing is reported."""
    top = "sys/fs/cgroup/"
    files = {f"{top}memory.max": GIB, f"{top}memory.current": GIB}
    assert free(system(tmp_path, "0::/\n", **files)) == 1
