"""Tests that run on the simulated GPU, in separate processes, which `test_simulated` starts."""
