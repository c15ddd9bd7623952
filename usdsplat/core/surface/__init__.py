"""Surfaces made into triangles: polygons, subdivision surfaces and USD's geometric primitives."""
