"""Render AOVs from a render scene and a view. This package does not depend on USD."""
