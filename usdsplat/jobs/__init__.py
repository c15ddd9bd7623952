"""Jobs: commands as many tasks, which this machine, Dask or a farm runs.

A job is a value. Its tasks are command lines of ours that write whole files or none, so whoever
runs them may repeat, move or kill them, and the files are the same.
"""
