"""The still life as a whole."""

from __future__ import annotations

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.interchange.procedural import light, meadow, plinth, shell, tiles

FEWEST = 2_000


def capture(count: int = 200_000, seed: int = 7) -> SplatCloud:
    """Model and light a still life: an opal shell in a gold cup on marble, amid tiles and grass.

    Args:
        count: About how many splats to make, at least 2000; detail follows its square root.
        seed: Another seed grows another meadow and glazes other tiles; equal arguments give equal
            clouds.

    Returns:
        Degree 3, display-referred sRGB, frame "rub", metres: a disc 2 m across around the origin,
        ground at y = 0, 0.8 m high. It is seen best from +z, a little from above.

    Raises:
        UsageError: If `count` is too small to show anything.
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
