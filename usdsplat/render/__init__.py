"""From a render scene and a view to AOVs. It knows nothing of USD."""
