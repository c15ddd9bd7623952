"""Tests that run on the simulated GPU, in processes of their own; `test_simulated` starts them."""
