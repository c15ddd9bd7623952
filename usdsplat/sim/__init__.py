"""Particle simulation of splat fields: reads a stage, writes a layer of results."""
