"""Fewer splats for the same picture."""
