"""Products: what a user orders of a stage, as values and functions that take an open engine.

`request` and `planning` decide which pictures are drawn, `header` what their files say, `drawing`
draws and writes them. Commands, the preview and scripts order here: no other module writes a
picture file of a stage.
"""
