"""The only access for edits of the render scene."""

from __future__ import annotations

from usdsplat.render.scene import RenderScene


class RenderParam:
    """Holder of the render scene that counts edits, so that a RenderPass can detect changes."""

    def __init__(self, scene: RenderScene) -> None:
        self.scene = scene
        """The render scene; read only."""
        self.version = 0

    def edit(self) -> RenderScene:
        """Return the scene for editing; cached results become invalid."""
        self.version += 1
        return self.scene
