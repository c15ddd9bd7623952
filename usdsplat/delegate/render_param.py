"""The only door to the render scene."""

from __future__ import annotations

from usdsplat.render.scene import RenderScene


class RenderParam:
    """Holds the render scene and counts edits, so that a RenderPass can tell stale from fresh."""

    def __init__(self, scene: RenderScene) -> None:
        self.scene = scene
        """For reading."""
        self.version = 0

    def edit(self) -> RenderScene:
        """Return the scene for editing; whoever cached a result must now recompute."""
        self.version += 1
        return self.scene
