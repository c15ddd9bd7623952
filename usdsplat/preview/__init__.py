"""An interactive view of a stage, with usdview's controls; its models work without a window."""
