"""Data types and algebra of splats: NumPy only, no files, no USD, no Numba."""
