"""How large the bands of a picture are, so that it has the memory that it needs."""

from __future__ import annotations

from dataclasses import dataclass

from usdsplat.core.errors import UsageError
from usdsplat.core.wording import counted, said_bytes
from usdsplat.delegate.engine import Engine
from usdsplat.images.aovs import AOVS
from usdsplat.kernels.bins import TILE
from usdsplat.products.request import PicturePlan
from usdsplat.render.memory import Estimate, PictureRequest, fitting
from usdsplat.render.renderer import BAND_PIXELS
from usdsplat.render.specs import View

DEEP_PIXELS = 1 << 17
"""[pixel] of a band of a deep picture, whose pixels hold any number of samples."""
TALLER = 4
"""How much taller the bands of many samples are: each is projected anew for each band."""
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
        return (
            f"needs about {said_bytes(parts.total)}: {said_bytes(parts.held)} for the program and "
            f"the scene, {said_bytes(parts.splats)} for what is seen of it, "
            f"{said_bytes(parts.band)} for a band of {counted(parts.rows, 'row')}"
        )


def budget(engine: Engine, plan: PicturePlan, view: View, *, limit: int | None) -> Budget:
    """Choose the bands of a picture, at the engine's time.

    Args:
        view: What is looked at.
        limit: [byte] that it may take; None for any.

    Raises:
        UsageError: If it takes more with bands of one row of tiles.
    """
    x0, y0, x1, y1 = view.framing.window
    width, usual = x1 - x0, DEEP_PIXELS if plan.deep else BAND_PIXELS
    if plan.settings.samples > 1 and not plan.deep:
        usual *= TALLER
    request = PictureRequest(
        aovs=tuple(AOVS[name].hydra for name in plan.aovs),
        holds_out=plan.holdout is not None,
        deep=plan.deep,
        baked=plan.is_baked,
        pictures=2 if plan.deep and plan.compare else 1,
    )

    def needed(tiles: int) -> Estimate:
        return engine.estimate(view, plan.settings, request, band_pixels=tiles * TILE * width)

    all_tiles = y1 // TILE - y0 // TILE + (y1 % TILE > 0)
    most = max(1, min(usual // width // TILE, all_tiles))
    if limit is None:
        return Budget(band_pixels=most * TILE * width, estimate=needed(most))
    tiles, estimate = fitting(needed, most, limit)
    if estimate.total > limit:
        expected = (
            f"{said_bytes(estimate.total)} or more for {width}x{y1 - y0} pixels of this scene"
        )
        raise UsageError("--memory-limit", said_bytes(limit), expected)
    return Budget(band_pixels=tiles * TILE * width, estimate=estimate)
