"""Searches among points, buffers included: what simulation and interchange both ask for.

The loops are `kernels/sim`'s; here are arrays in, new arrays out.
"""
