"""A capture of our own making: nobody's scan, no download, the same on every machine.

`capture()` models a still life (`shell`, `plinth`, `tiles`, `meadow`), covers it with splats
(`patch`) and bakes the light of an afternoon into harmonics (`light`), so that its colours depend
on the view as a scan's do.
"""

from __future__ import annotations

from usdsplat.interchange.procedural.scene import capture

__all__ = ["capture"]
