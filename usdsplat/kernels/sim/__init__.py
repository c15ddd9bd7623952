"""The simulation in Numba: arrays in, arrays out, the same bits on any number of threads."""
