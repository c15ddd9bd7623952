"""Live simulations: in their own threads, onto a removable layer."""
