"""How large the bands of a picture are, so that it has the memory that it needs."""

from __future__ import annotations

from dataclasses import dataclass

from usdsplat.cli.request import Picture
from usdsplat.cli.values import said_bytes
from usdsplat.core.errors import UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.memory import Estimate
from usdsplat.delegate.renderer import BAND_PIXELS
from usdsplat.delegate.specs import View
from usdsplat.images.aovs import AOVS
from usdsplat.kernels.bins import TILE

DEEP_PIXELS = 1 << 17
"""[pixel] of a band of a deep picture, whose pixels hold any number of samples."""
WORTH_SAYING = 1 << 30
"""[byte] from which on what a picture needs is said before it is drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What is known of a picture's memory before it is drawn."""

    band_pixels: int
    """As `Engine.render` takes it."""
    estimate: Estimate

    def sentence(self) -> str:
        """What it needs, in words."""
        parts = self.estimate
        rows = f"a band of {parts.rows} rows"
        return (
            f"needs about {said_bytes(parts.total)}: {said_bytes(parts.held)} for the program and "
            f"the scene, {said_bytes(parts.splats)} for what is seen of it, "
            f"{said_bytes(parts.band)} for {rows}"
        )


def budget(engine: Engine, picture: Picture, view: View, *, limit: int | None) -> Budget:
    """Choose the bands of a picture, at the engine's time.

    Args:
        view: What is looked at.
        limit: [byte] that it may take; None for any.

    Raises:
        UsageError: If it takes more with bands of one row of tiles.
    """
    x0, y0, x1, y1 = view.framing.window
    width, usual = x1 - x0, DEEP_PIXELS if picture.deep else BAND_PIXELS
    names = tuple(AOVS[name].hydra for name in picture.aovs)

    def found(tiles: int) -> Budget:
        pixels = tiles * TILE * width
        parts = engine.estimate(
            view,
            picture.settings,
            names,
            band_pixels=pixels,
            holds_out=picture.holdout is not None,
            deep=picture.deep,
            baked=picture.is_baked,
            pictures=2 if picture.deep and picture.compare else 1,
        )
        return Budget(band_pixels=pixels, estimate=parts)

    most = max(1, min(usual // width, y1 - y0) // TILE)
    best = found(most)
    if limit is None or best.estimate.total <= limit:
        return best
    best, low, high = found(1), 1, most
    if best.estimate.total > limit:
        where, size = "--memory-limit", f"{width}x{y1 - y0}"
        expected = f"{said_bytes(best.estimate.total)} or more for {size} pixels of this scene"
        raise UsageError(where, said_bytes(limit), expected)
    while high - low > 1:
        middle = (low + high) // 2
        tried = found(middle)
        if tried.estimate.total <= limit:
            best, low = tried, middle
        else:
            high = middle
    return best
