"""Kernels of the simulation whose threads work together."""
