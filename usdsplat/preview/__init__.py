"""A window onto a stage, with usdview's habits; every model of it works without a window."""
