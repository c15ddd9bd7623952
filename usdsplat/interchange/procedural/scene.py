"""Assemble the still life."""

from __future__ import annotations

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.interchange.procedural import light, meadow, plinth, shell, tiles

FEWEST = 2_000


def capture(count: int = 200_000, seed: int = 7) -> SplatCloud:
    """Model and light a still life: an opal shell in a gold cup on marble, amid tiles and grass.

    Args:
        count: Approximate number of splats, at least 2000; detail follows its square root.
        seed: Random seed of the meadow and the tiles; equal arguments give equal clouds.

    Returns:
        A cloud of degree 3, display-referred sRGB, axes "rub", in metres: a disc 2 m across around
        the origin, ground at y = 0, 0.8 m high. The best view is from +z, slightly from above.

    Raises:
        UsageError: If `count` is below the minimum.
    """
    if count < FEWEST:
        raise UsageError("count", str(count), f"{FEWEST} or more")
    density = (count / 200_000) ** 0.5
    spacing = 0.0056 / density
    patches = [
        *shell.shell(spacing, seat=plinth.TOP + 0.142),
        *plinth.cup(spacing),
        plinth.drum(spacing),
        *plinth.vines(density, seed),
        *tiles.tiles(spacing, seed),
        *plinth.stonework(spacing),
        meadow.soil(spacing),
        meadow.grass(round(0.05 * count), seed),
        *meadow.flowers(round(0.0013 * count), seed),
    ]
    return light.bake(patches)
