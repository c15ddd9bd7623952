"""Shade surfaces on a GPU, with one thread for each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS
from usdsplat.kernels.shade import clear, shade_stretch


@kernel
def _shade(view, shapes, normal_matrices, looks, lights, origin, winner, out):
    height, width = winner.shape
    for pixel in range(cuda.grid(1), height * width, cuda.gridsize(1)):
        row, column = pixel // width, pixel % width
        t = winner[row, column]
        if t < 0:
            clear(row, column, column + 1, out)
        else:
            shade_stretch(
                view[0], shapes, normal_matrices, looks, lights, t, np.float64(origin[0]),
                np.float64(origin[1] + row), row, column, column + 1, out,
            )  # fmt: skip


def shade(device: CudaDevice, *args: Any) -> None:
    """Shade the nearest triangle of each pixel, see `kernels.shade.shade`."""
    _shade[BLOCKS, THREADS, device.stream](*args)
