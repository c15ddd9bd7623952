"""The still life as a whole."""

from __future__ import annotations

from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange.procedural import garden, light, shell


def capture(count: int = 200_000, seed: int = 7) -> SplatCloud:
    """Model and light a still life: an iridescent shell on marble amid gold, tiles and grass.

    Args:
        count: About how many splats to make; detail follows its square root.
        seed: Another seed grows another meadow; equal arguments give equal clouds.

    Returns:
        Degree 3, display-referred sRGB, frame "rub", metres: a disc 2 m across around the origin,
        ground at y = 0, 0.8 m high. Seen best from +z, a little above.
    """
    density = (count / 200_000) ** 0.5
    spacing = 0.0056 / density
    patches = [
        *shell.shell(spacing),
        shell.cup(spacing),
        shell.drum(spacing),
        *shell.tendrils(density, seed),
        *garden.tiles(spacing, seed),
        *garden.stonework(spacing),
        garden.earth(spacing),
        garden.grass(round(0.05 * count), seed),
        *garden.flowers(round(0.0013 * count), seed),
    ]
    return light.bake(patches)
