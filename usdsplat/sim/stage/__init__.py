"""The part of the simulation that uses USD: reads a stage, writes a layer."""
