"""Gaussian splats as ordinary citizens of a USD pipeline.

Importing this package loads neither `pxr` nor `numba`; each subpackage says what it needs.
"""

__version__ = "0.6.0"
