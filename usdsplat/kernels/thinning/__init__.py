"""Reduce the number of splats."""
