"""Search points, with allocation of results, for simulation and interchange.

The loops are in `kernels/sim`. Functions here take arrays and return new arrays.
"""
