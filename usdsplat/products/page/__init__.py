"""Pages that show captures, cameras and their animation in a browser, without a server.

A page is one file with everything inside, the viewer too (`viewer/`, the work of others), or a
folder with `index.html` for a host. `write_page` is the only function that others need.
"""

from __future__ import annotations

from usdsplat.products.page.camera import PageRequest
from usdsplat.products.page.writing import PageReport, write_page

__all__ = ["PageReport", "PageRequest", "write_page"]
