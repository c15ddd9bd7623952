"""What a picture waits for, and what ends it."""

from __future__ import annotations

from dataclasses import dataclass

from usdsplat.core.cancel import CancelToken


@dataclass(frozen=True, slots=True, kw_only=True)
class Patience:
    """What a picture waits for."""

    cancel: CancelToken | None = None
    """Ends the picture after its current stage, and its light after the current sample."""
    light: bool = True
    """Whether light is computed that is not kept. Else splats keep their last light, or have that
    of the capture if there is none, and lights whose depth maps are not kept shine on surfaces
    without shadows."""

    @property
    def token(self) -> CancelToken:
        """`cancel`, or a token that nobody cancels."""
        return self.cancel or CancelToken()


ENDLESS = Patience()
"""The patience of a picture for a file: it waits for everything."""
