"""Tests of the cluster that `--dask local` starts."""

from __future__ import annotations

import os
import sys
import warnings
from contextlib import suppress
from pathlib import Path

import pytest

from tests.jobs.test_local import children

pytest.importorskip("distributed")


def listening(pids):
    """The addresses on which processes listen, as /proc has them: hexadecimal, least byte first."""
    sockets = set()
    for pid in pids:
        with suppress(OSError):  # the process has ended
            for each in list(Path(f"/proc/{pid}/fd").iterdir()):
                with suppress(OSError):  # the file is closed
                    target = os.readlink(each)
                    sockets |= {target[8:-1]} if target.startswith("socket:[") else set()
    found = set()
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/self/net/{name}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in sockets:
                found.add(words[1].split(":")[0])
    return found


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_only_this_machine_reaches_it():
    """Oracle: the sockets of scheduler and workers in /proc: all have the address 127.0.0.1. A port
    that is taken by another cluster is no warning."""
    from distributed import Client

    from usdsplat.jobs.dask_local import LocalCluster

    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        with (
            LocalCluster([{}], None) as one,
            LocalCluster([{}], None),
            Client(one.cluster) as client,
        ):
            client.wait_for_workers(1, timeout=60)
            assert listening([os.getpid(), *children(os.getpid())]) == {"0100007F"}
