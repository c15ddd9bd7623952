"""Fixtures of the fault tests: inputs, and a process that runs commands with faults."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.faults.harness import Runner, compile_shim
from tests.faults.inputs import write_inputs


@pytest.fixture(scope="session")
def runner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runner]:
    """Runs commands while writing fails; tests that need it skip visibly without a C compiler."""
    folder = tmp_path_factory.mktemp("faults")
    shim = compile_shim(folder)
    if shim is None:
        pytest.skip("no C compiler, or not Linux")
    write_inputs(folder)
    runner = Runner(folder, shim)
    yield runner
    runner.close()
