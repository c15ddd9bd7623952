"""Tests of saving and loading states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.schema.clouds import cloud
from tests.sim.stage.bakes import Solver
from usdsplat.core.errors import FormatError
from usdsplat.sim import checkpoint
from usdsplat.sim.arrays_file import ALIGNMENT, load_arrays, save_arrays
from usdsplat.sim.checkpoint import Checkpoint


def moved(seed: int, steps: int) -> Solver:
    solver = Solver.of(cloud(seed, n=9, degree=2))
    for _ in range(steps):
        solver.step()
    return solver


def saved(path: Path, **solvers: Solver) -> Checkpoint:
    states = {f"/{name}": solver.state for name, solver in solvers.items()}
    extras = {"note": np.arange(5, dtype=np.uint16)}
    checkpoint.save(
        path,
        Checkpoint(time=7.5, states=states, parameter_hash="abc", extras=extras),
    )
    return checkpoint.load(path)


def test_every_bit_of_several_states_comes_back(tmp_path: Path) -> None:
    """Oracle: the states' own digests, and what they do next."""
    solvers = {"A": moved(1, 4), "B": moved(2, 7)}
    solvers["A"].state.positions[0] = (np.nan, -0.0, 1e-45)
    found = saved(tmp_path / "c", **solvers)
    assert (found.time, found.parameter_hash) == (7.5, "abc")
    np.testing.assert_array_equal(found.extras["note"], np.arange(5))
    for name, solver in solvers.items():
        restored = Solver(found.states[f"/{name}"])
        assert restored.state.digest() == solver.state.digest()
        for each in (solver, restored):
            each.step()
        assert restored.state.digest() == solver.state.digest()


def test_one_array_stays_one_array(tmp_path: Path) -> None:
    """Oracle: object identity: `sh` is `rest_sh` until a splat turns."""
    solver = Solver.of(cloud(n=300, degree=3))
    found = saved(tmp_path / "c", A=solver).states["/A"]
    assert found.sh is found.rest_sh
    assert found.positions is not found.rest_positions
    found.positions[0] = 0  # arrays can be written


@pytest.mark.parametrize("shape", [(), (0,), (0, 3), (2, 3, 4)], ids=str)
@pytest.mark.parametrize("dtype", ["f4", "f8", "i8", "u4", "?", "i2", "U5"])
def test_arrays_of_any_shape_and_type(tmp_path: Path, shape: tuple[int, ...], dtype: str) -> None:
    """Oracle: the array itself, also where it is not contiguous."""
    array = np.ones(shape, dtype)[..., ::-1] if shape else np.ones(shape, dtype)
    save_arrays(tmp_path / "a", {"x": array}, {})
    for mapped in (False, True):
        found = load_arrays(tmp_path / "a", mapped=mapped)[0]["x"]
        assert (found.dtype, found.shape) == (array.dtype, shape)
        np.testing.assert_array_equal(found, array)


def test_arrays_lie_where_they_can_be_mapped(tmp_path: Path) -> None:
    """Oracle: the bytes at multiples of the alignment in the file."""
    arrays = {"a": np.arange(7, dtype=np.float32), "b": np.arange(3, dtype=np.int64) + 99}
    save_arrays(tmp_path / "a", arrays, {})
    data = (tmp_path / "a").read_bytes()
    for array in arrays.values():
        assert data.index(array.tobytes()) % ALIGNMENT == 0


def test_damage_is_refused_wherever_it_is(tmp_path: Path) -> None:
    """Oracle: every byte of the file that holds anything, and every length."""
    path = tmp_path / "c"
    save_arrays(path, {"x": np.arange(16, dtype=np.float64)}, {"k": 1})
    good = path.read_bytes()
    padding = good.index(np.arange(16, dtype=np.float64).tobytes())
    end = good.index(b"}]}") + 3
    for place in [*range(0, end), *range(padding, len(good))]:
        path.write_bytes(good[:place] + bytes([good[place] ^ 0x55]) + good[place + 1 :])
        with pytest.raises(FormatError, match="a damaged file"):
            load_arrays(path)
    for length in range(len(good)):
        path.write_bytes(good[:length])
        with pytest.raises(FormatError, match="a damaged file"):
            load_arrays(path)
    path.write_bytes(good)
    load_arrays(path)


def test_other_arrays_are_no_checkpoint(tmp_path: Path) -> None:
    """Oracle: the sentence."""
    save_arrays(tmp_path / "c", {}, {})
    with pytest.raises(FormatError, match="expected a checkpoint of a simulation"):
        checkpoint.load(tmp_path / "c")


def test_a_checkpoint_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    """Oracle: the older file's bytes after a write that fails."""
    path = tmp_path / "c"
    save_arrays(path, {"x": np.zeros(3)}, {})
    before = path.read_bytes()
    with pytest.raises(ValueError, match="objects"):
        save_arrays(path, {"x": np.zeros(9), "y": np.array([None])}, {})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
