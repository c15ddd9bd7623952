"""Numba kernels: arrays in, arrays out. They never allocate a result, raise, log or know USD.

Each module is one stage of a frame: first the mathematics of one splat (scalars only, compiled for
whichever target calls it), then the loops that walk arrays. `device` is the only door to them.

    project -> radiance -> sort -> bins -> blend -> median -> recolor

`reference` is the same picture in plain float64 NumPy, slow and readable, for tests to compare
with.
"""
