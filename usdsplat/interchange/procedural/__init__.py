"""A procedural capture: no scan or download is needed, and it is the same on every machine.

`capture()` models a still life (`shell`, `plinth`, `tiles`, `meadow`), covers it with splats
(`patch`) and bakes afternoon light into harmonics (`light`), so that its colours depend on the view
as in a scan.
"""

from __future__ import annotations

from usdsplat.interchange.procedural.scene import capture

__all__ = ["capture"]
