"""Repeatable measurements.

Each prints a table, with the floor and a peer measured in the same run.
"""
