"""Tests of the CPU device, and of the cache of compiled kernels."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import types
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.devices import all_cores
from usdsplat.core.errors import BackendError, UsageError
from usdsplat.kernels import ahead, sort, store
from usdsplat.kernels.cuda import support
from usdsplat.kernels.device import CpuDevice, cores
from usdsplat.kernels.devices import automatic, open_device


def test_an_unknown_device_is_one_sentence():
    """Oracle: the wording of errors, where: found, expected."""
    with pytest.raises(
        BackendError, match="device: found 'abacus', expected auto or one of: cpu, cuda"
    ):
        open_device("abacus")


@pytest.fixture
def broken_gpu(monkeypatch):
    """A GPU with all packages whose driver refuses."""

    class CudaDevice:
        def __init__(self, *, threads=None):
            raise OSError("the driver is\ntoo old")

    place = "usdsplat.kernels.cuda.device"
    module = types.ModuleType(place)
    module.CudaDevice = CudaDevice
    monkeypatch.setitem(sys.modules, place, module)
    monkeypatch.setattr("usdsplat.kernels.devices.automatic", lambda *_: ("cuda", ""))
    monkeypatch.setattr(support, "obstacle", lambda: None)


def test_a_gpu_that_does_not_start_is_one_sentence(broken_gpu):
    """Oracle: the wording of errors; who did not ask for it gets the CPU, and the sentence."""
    why = "OSError: the driver is too old"
    said = f"device cuda: found a GPU that cannot be started \\({why}\\), expected"
    with pytest.raises(BackendError, match=said):
        open_device("cuda")
    device = open_device("auto")
    assert device.name == "cpu"
    assert re.match(f"{said} a working GPU; the CPU is used$", device.remark)


@pytest.mark.parametrize("threads", [0, -1, 10_000])
def test_threads_out_of_range_are_refused(threads):
    """Oracle: this machine's number of cores, as Numba counts them."""
    with pytest.raises(UsageError, match="threads"):
        open_device("cpu", threads=threads)


def test_a_launch_leaves_the_callers_thread_count_alone():
    """Oracle: Numba's own setting, before and after."""
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    before = numba.get_num_threads()
    seen = CpuDevice(threads=1).run(numba.get_num_threads)
    assert seen == 1
    assert numba.get_num_threads() == before


def test_upload_copies_only_what_kernels_cannot_read():
    """Oracle: numpy's own view of shared memory."""
    device = CpuDevice()
    array = np.zeros((4, 3), np.float32)
    assert np.shares_memory(device.upload(array), array)
    assert not device.upload(array).flags.writeable
    assert array.flags.writeable
    turned = device.upload(array[:, ::-1])
    assert turned.flags.c_contiguous
    assert not np.shares_memory(turned, array)


def test_two_threads_may_launch_at_once():
    """Oracle: np.argsort; under Numba's plainest threading layer this would abort the process."""
    keys = np.random.default_rng(0).random(20_000, dtype=np.float32)
    expected = np.argsort(keys, kind="stable")
    results = []

    def work():
        visible = np.arange(len(keys), dtype=np.int32)
        scratch = (np.zeros((2, len(keys)), np.uint32), np.zeros((2, len(keys)), np.int32))
        for _ in range(20):
            half = all_cores().run(
                sort.depth_order,
                visible,
                len(keys),
                keys,
                8,
                scratch,
                np.zeros((8, 2048), np.int64),
            )
        results.append(scratch[1][half])

    workers = [threading.Thread(target=work) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(results) == 3
    for result in results:
        np.testing.assert_array_equal(result, expected)


def told_by_a_process(code: str, home: Path, package: Path | None = None) -> str:
    """What a fresh process prints whose user's caches are at `home`; `package` replaces ours."""
    paths = [str(package.parent)] if package else []
    return subprocess.run(
        [sys.executable, "-c", code],
        env={name: value for name, value in os.environ.items() if name != store.VARIABLE}
        | {"XDG_CACHE_HOME": str(home), "HOME": str(home)}
        | {"PYTHONPATH": os.pathsep.join([*paths, os.environ.get("PYTHONPATH", "")])},
        cwd=paths[0] if paths else None,
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled without the compiler")
def test_a_second_process_loads_what_the_first_one_compiled(tmp_path):
    """Oracle: Numba's own events; both processes get the numbers written down by hand. Damaged
    entries, and a home that is read-only, cost a compilation and nothing else."""
    code = """
import numpy as np
from usdsplat.kernels import sort, store
from usdsplat.kernels.compiling import on_compile
compiled = []
visible = np.zeros(8, np.int32)
with on_compile(compiled.append):
    sort.visible_slots(np.int32([2, 0, 1]), np.int64([0, 4, 8]), 3, visible)
print(compiled, visible[:3].tolist(), "refused" if store.refusal() else "kept")
"""
    afresh, kept = "['visible_slots'] [0, 1, 8] kept", "[] [0, 1, 8] kept"
    assert told_by_a_process(code, tmp_path) == afresh
    assert told_by_a_process(code, tmp_path) == kept
    entries = [path for path in tmp_path.rglob("*") if path.is_file()]
    for path in entries:
        path.write_bytes(path.read_bytes()[:-7] + b"damaged")
    assert told_by_a_process(code, tmp_path) == afresh
    assert told_by_a_process(code, tmp_path) == kept
    for path in entries:
        path.write_bytes(b"")
    assert told_by_a_process(code, tmp_path) == afresh
    home = tmp_path / "a file, no home"
    home.write_text("")
    assert told_by_a_process(code, home) == "['visible_slots'] [0, 1, 8] refused"


@pytest.mark.parametrize(
    ("task", "seconds", "is_noted", "expected"),
    [
        ("pictures", None, True, "cuda"),
        ("pictures", None, False, "cpu"),
        ("pictures", 1.0, True, "cpu"),
        ("pictures", 10.0, True, "cuda"),
        ("pictures", 10.0, False, "cpu"),
        ("pictures", 1000.0, False, "cuda"),
        ("geometry", 1000.0, True, "cpu"),
    ],
)
def test_auto_is_the_device_that_is_done_first(monkeypatch, task, seconds, is_noted, expected):
    """Oracle: what a GPU's start and compilation take, as the module says; only who might wait for
    a compilation for nothing is told of it."""
    monkeypatch.setattr(support, "capability", lambda: (9, 0))
    monkeypatch.setattr(support, "obstacle", lambda: None)
    monkeypatch.setattr(ahead, "is_noted", lambda *_: is_noted)
    name, remark = automatic(task, seconds)
    assert name == expected
    assert bool(remark) == (seconds is None and not is_noted)


def test_who_has_a_gpu_and_not_its_packages_is_told_which(monkeypatch):
    """Oracle: the sentence that an order for the GPU gets; to compile would not help."""
    missing = "a GPU but no package numba-cuda", support.INSTALL
    monkeypatch.setattr(support, "capability", lambda: (9, 0))
    monkeypatch.setattr(support, "obstacle", lambda: missing)
    monkeypatch.setattr(ahead, "is_noted", lambda *_: False)
    expected = f"device cuda: found {missing[0]}, expected {missing[1]}"
    assert automatic("pictures") == ("cpu", expected)


def test_the_environment_says_how_many_threads_there_are(monkeypatch):
    """Oracle: the variable; what asks for threads does not read it, and what is no number of cores
    is one sentence."""
    monkeypatch.setenv("USDSPLAT_THREADS", "1")
    assert CpuDevice().threads == 1 and all_cores().threads == cores()
    monkeypatch.delenv("USDSPLAT_THREADS")
    assert CpuDevice().threads == cores()
    for wrong in ("0", "-1", "two", str(cores() + 1), "¹"):
        monkeypatch.setenv("USDSPLAT_THREADS", wrong)
        with pytest.raises(UsageError, match=f"USDSPLAT_THREADS: found '{wrong}', expected 1 to"):
            CpuDevice()
