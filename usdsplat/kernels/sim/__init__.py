"""Numba kernels of the simulation: arrays in, arrays out.

Results do not depend on the number of threads.
"""
