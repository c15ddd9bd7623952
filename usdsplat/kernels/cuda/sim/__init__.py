"""CUDA kernels of the simulation whose threads cooperate."""
