"""Measurements that anybody can repeat: each prints a table, with floor and peer in the same
run."""
