"""Tests of `kernels.normals`."""
