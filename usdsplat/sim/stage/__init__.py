"""The part of the simulation that knows USD: reads a stage, writes a layer."""
