"""Tests of everything that the delegate draws, on the simulator, with few splats and pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.render.everything import CASES, Case, drawn, drawn_deep
from usdsplat.kernels.cuda import walk
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.quarter_lists import SIDE
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.launch import Kernel
from usdsplat.render.deep_samples import DEEP_IDS

SIZE, SPLATS = (20, 18), 7
DEEP = ("splats alone", "deep holdout")
DRAWN = (
    "surfaces", "crops", "distance", "rays and surfaces", "matte splats", "flat holdout alone",
    "ellipses", "budget", "samples", "tree",
)  # fmt: skip
"""Cases that between them launch every form."""


COARSE = {"shadow_resolution": 16, "light_samples": 1}
"""Settings of lights, whose pictures would take most of the time here."""


def small(name: str) -> Case:
    """A case with pictures of lights that are as small as its own."""
    return replace(CASES[name], settings={**CASES[name].settings, **COARSE})


class PythonDevice(CpuDevice):
    """The CPU's loops as Python, to which fields of records are attributes too."""

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with records that have attributes."""
        given = tuple(map(_with_attributes, args))
        return kernel.on_cpu(given) if isinstance(kernel, Kernel) else kernel(*given)


def _with_attributes(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_with_attributes, value))
    is_record = isinstance(value, np.ndarray) and value.dtype.names
    return value.view(np.recarray) if is_record else value


@pytest.mark.parametrize("name", DRAWN)
def test_all_aovs_are_those_of_the_cpu(name: str) -> None:
    """Oracle: the CPU's loops, in Python here as the kernels are, so to rounding."""
    ours = drawn(CudaDevice(), small(name), size=SIZE, splats=SPLATS)
    theirs = drawn(PythonDevice(threads=1), small(name), size=SIZE, splats=SPLATS)
    # the GPU counts no rows outside the picture
    np.testing.assert_allclose(ours.pop("stats"), theirs.pop("stats"), rtol=0.2)
    for each in theirs:
        np.testing.assert_allclose(ours[each], theirs[each], rtol=1e-4, atol=1e-5, err_msg=each)


@pytest.mark.parametrize("places", [walk.SHARED_PLACES, 2])
def test_windows_that_overflow_are_followed_by_longer_ones(
    monkeypatch: pytest.MonkeyPatch, places: int
) -> None:
    """Windows of one and two contributions, and then of any number; also in lists that are longer
    than the former can address. Oracle: the CPU's loops."""
    monkeypatch.setattr(walk, "SHARED_PLACES", places)
    short = walk._ray_walk("walk_rays", SIDE, SIDE, 1)
    longer = walk._ray_walk("walk_few_rows", SIDE, walk.FEW_ROWS, 2)
    monkeypatch.setattr(walk, "_WALK_RAYS", short)
    monkeypatch.setattr(walk, "_WALK_FEW_ROWS", longer)
    longest: list[Any] = []
    groups = walk._groups
    monkeypatch.setattr(walk, "_groups", lambda lengths: longest.append(lengths) or groups(lengths))
    case = small("rays and surfaces")
    ours = drawn(CudaDevice(), case, size=SIZE, splats=SPLATS)
    theirs = drawn(PythonDevice(threads=1), case, size=SIZE, splats=SPLATS)
    assert longest and all(lengths.size for lengths in longest)
    for each in set(theirs) - {"stats"}:
        np.testing.assert_allclose(ours[each], theirs[each], rtol=1e-4, atol=1e-5, err_msg=each)


@pytest.mark.parametrize("name", DEEP)
def test_ids_of_deep_samples_are_those_of_the_cpu(name: str) -> None:
    """Oracle: the CPU's loops."""
    options = {"size": SIZE, "splats": SPLATS, "aovs": DEEP_IDS}
    (ours,) = drawn_deep(CudaDevice(), small(name), 0.0, **options)
    (theirs,) = drawn_deep(PythonDevice(threads=1), small(name), 0.0, **options)
    assert len(theirs.ids) > 10
    np.testing.assert_array_equal(ours.ids, theirs.ids)
    np.testing.assert_allclose(ours.depth, theirs.depth, rtol=1e-5)


@pytest.mark.parametrize("name", DEEP)
def test_deep_samples_are_those_of_the_cpu(name: str) -> None:
    """Oracle: the CPU's loops."""
    (ours,) = drawn_deep(CudaDevice(), small(name), 0.01, size=SIZE, splats=SPLATS)
    (theirs,) = drawn_deep(PythonDevice(threads=1), small(name), 0.01, size=SIZE, splats=SPLATS)
    for field in ("counts", "depth", "depth_back", "color", "left"):
        np.testing.assert_allclose(
            getattr(ours, field), getattr(theirs, field), rtol=1e-4, atol=1e-5, err_msg=field
        )
