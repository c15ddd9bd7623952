"""A stage becomes a layer: captures as particles, simulated, and baked as opinions over them."""
