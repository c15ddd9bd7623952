"""Produce what users request from a stage, as values and functions that use an open engine.

`request` and `planning` select the pictures, `header` describes them in their files, `drawing`
draws and writes them. Commands, the preview and scripts use this package. No other module writes
picture files of a stage.
"""
