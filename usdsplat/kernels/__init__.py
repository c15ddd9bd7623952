"""Numba kernels, which read and write arrays. They do not allocate results, raise errors, log or
use USD.

The module of each stage of a frame has first the mathematics of one splat (scalars only, compiled
for each target that calls it), then the loops over arrays. Kernels are run only through `device`.

    project -> radiance -> sort -> bins -> blend -> median -> recolor

`reference` computes the same picture in plain float64 NumPy, slow and readable, for tests.
"""
