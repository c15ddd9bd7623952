"""Build CUB's radix sort and prefix sum for our types, and store them for later processes.

A build takes seconds. It needs the GPU on which it will run: a radix sort that `cuda.compute` 1.2
builds for another capability gives wrong results.

Source: NVIDIA's CUB; its radix sort is stable.
"""

from __future__ import annotations

import functools
import importlib.metadata
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels import store
from usdsplat.kernels.compiling import compiled
from usdsplat.kernels.cuda.support import SORT, SUM, capability

PACKAGES = ("cuda-cccl", "nvidia-cuda-nvrtc", "nvidia-nvjitlink")
"""Packages whose versions a build depends on."""


def build(algorithm: str, types: str) -> bytes:
    """Return an algorithm for the GPU in use: the stored build, or a new one, which is stored.

    Args:
        algorithm: SORT or SUM.
        types: Types of keys and values, or of input and output, such as "u4 i4".

    Returns:
        The input of `cuda.compute.deserialize`.
    """
    import cuda.compute as compute

    key = store.key_of("cub", algorithm, types, repr(capability()), _versions())
    kept = store.load(key)
    if kept is not None:
        return kept
    first, second = (cuda.device_array(1, np.dtype(each)) for each in types.split())
    with compiled({SORT: "sort_pairs", SUM: "running_sum"}[algorithm]):
        if algorithm == SORT:
            made = compute.make_radix_sort(
                d_in_keys=first,
                d_out_keys=first,
                d_in_values=second,
                d_out_values=second,
                order=compute.SortOrder.ASCENDING,
            )
        else:
            made = compute.make_exclusive_scan(
                d_in=first,
                d_out=second,
                op=compute.OpKind.PLUS,
                init_value=np.zeros(1, second.dtype),
            )
    data: bytes = compute.serialize(made)
    store.save(key, data)
    return data


def load(algorithm: str, types: str) -> Any:
    """Return a built algorithm as an object of `cuda.compute`. For arguments see `build`."""
    import cuda.compute as compute

    return compute.deserialize(build(algorithm, types))


# --- private -------------------------------------------------------------------------------


@functools.cache
def _versions() -> str:
    return " ".join(f"{each} {_version(each)}" for each in PACKAGES)


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""
