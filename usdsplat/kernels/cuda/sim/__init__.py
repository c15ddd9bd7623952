"""Kernels of the simulation that are written for a GPU; `derive` makes the others."""
