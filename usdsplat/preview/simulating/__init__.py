"""Simulations that run while one looks: in threads of their own, onto a layer that can go again."""
