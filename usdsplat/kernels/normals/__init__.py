"""Loops that compute the normals of splats, see `kernels.points.surface_normals`."""
