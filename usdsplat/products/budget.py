"""Choose the size of a picture's bands so that the picture fits in memory."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from usdsplat.core.errors import UsageError
from usdsplat.core.wording import counted, said_bytes
from usdsplat.delegate.engine import Engine
from usdsplat.images.aovs import aov_named
from usdsplat.kernels.bins import TILE
from usdsplat.products.deep_ids import deep_ids
from usdsplat.products.request import PicturePlan
from usdsplat.render.band import BAND_PIXELS
from usdsplat.render.deep_memory import deep_bytes, entries_within
from usdsplat.render.deep_merging import ENTRIES
from usdsplat.render.frame import DEEP_PIXELS
from usdsplat.render.lod.memory import held_node_bytes
from usdsplat.render.memory import Estimate, PictureRequest, fitting
from usdsplat.render.specs import View

WEBP, WEBP_LOSSLESS = 12, 40
"""Memory for each pixel of a WebP, and of one with alpha or without loss [byte]. Its encoder takes
the whole picture; measured with 16 million pixels."""
TALLER = 4
"""Factor on the height of bands with several samples, because each band projects the splats again
for each sample."""
WORTH_SAYING = 1 << 30
"""Memory from which the need of a picture is reported before it is drawn [byte]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """Band size and memory estimate of a picture."""

    band_pixels: int
    """See `Engine.render`."""
    deep_entries: int = ENTRIES
    """See `DeepSize`."""
    node_bytes: int | None = None
    """Memory for nodes of splat trees, also of other pictures, see `NodeCache.most`."""
    estimate: Estimate

    def sentence(self) -> str:
        """Return the memory need as a sentence."""
        parts = self.estimate
        return (
            f"needs about {said_bytes(parts.total)}: {said_bytes(parts.held)} for the program and "
            f"the scene, {said_bytes(parts.splats)} for its visible part, "
            f"{said_bytes(parts.band)} for a band of {counted(parts.rows, 'row')}"
            + (f", {said_bytes(parts.kept)} for the tile" if parts.kept else "")
        )


def with_node_memory(plan: PicturePlan, limit: int | None) -> PicturePlan:
    """Return the plan of a picture whose splat trees get half of a memory limit [byte], unless
    memory for them is chosen.

    A picture that needs more for them would hardly fit: its buffers take 250 bytes for a drawn
    splat, and nodes 56 to 236 up to degree 3.
    """
    if limit is None or plan.settings.node_memory:
        return plan
    memory = max(1, limit // 2 >> 20)
    return replace(plan, settings=replace(plan.settings, node_memory=memory))


def _encoded(plan: PicturePlan) -> int:
    """Return the memory for each pixel of a file that is encoded as a whole [byte]."""
    if Path(str(plan.output)).suffix.lower() != ".webp":
        return 0
    is_simple = plan.background is not None and plan.settings.jpeg_quality < 100
    return WEBP if is_simple else WEBP_LOSSLESS


def budget(
    engine: Engine,
    plan: PicturePlan,
    view: View,
    *,
    limit: int | None,
    held_nodes: float = 0.0,
    is_tile: bool = False,
) -> Budget:
    """Choose the bands of a picture, at the engine's time.

    Args:
        view: The view of the picture.
        limit: Maximum memory [byte]; None for no limit.
        held_nodes: Mean number of nodes in a pixel of a deep holdout.
        is_tile: Whether all pixels are kept until the end, see `tiles.draw_tile`.

    Raises:
        UsageError: If bands of one row of tiles take more than the limit.
    """
    x0, y0, x1, y1 = view.framing.window
    width, usual = x1 - x0, DEEP_PIXELS if plan.deep else BAND_PIXELS
    if plan.settings.samples > 1 and not plan.deep:
        usual *= TALLER
    request = PictureRequest(
        aovs=("color",) if plan.deep else tuple(aov_named(name).hydra for name in plan.aovs),
        holds_out=plan.holdout is not None,
        held_nodes=held_nodes,
        deep=plan.deep,
        deep_ids=len(deep_ids(plan.aovs)) if plan.deep else 0,
        baked=plan.is_baked,
        pictures=2 if plan.needs_flat else 1,
    )

    kept = width * (y1 - y0) * _kept_bytes(plan) if is_tile else 0

    def needed(tiles: int) -> Estimate:
        found = engine.estimate(view, plan.settings, request, band_pixels=tiles * TILE * width)
        band = found.band + _encoded(plan) * width * (y1 - y0)
        return replace(found, band=band, kept=kept)

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
    # The memory that the rest of a deep picture leaves is for contributions that are merged.
    entries, left = ENTRIES, limit - estimate.total
    if plan.deep:
        ids = request.deep_ids
        size = estimate.rows * width * deep_bytes(plan.settings, ids) + left
        entries, left = entries_within(plan.settings, ids, size), 0
    return Budget(
        band_pixels=tiles * TILE * width,
        deep_entries=entries,
        node_bytes=held_node_bytes(engine.render_scene, view, plan.settings) + left,
        estimate=estimate,
    )


def _kept_bytes(plan: PicturePlan) -> int:
    """Return the bytes of a pixel of a tile; for deep ones, which are copied once, an estimate."""
    settings = plan.settings
    if plan.deep:
        return 2 * deep_bytes(settings, len(deep_ids(plan.aovs)))
    drawn = (aov_named(name).with_rank(settings.crypto_rank) for name in plan.aovs)
    return 4 * sum(len(aov.channels) for aov in drawn)
