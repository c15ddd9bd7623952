"""What a picture says about how it was made, as header entries."""

from __future__ import annotations

import json

from usdsplat.images.layout import Metadata


def picture_metadata(*, stage: str, frame: float, samples: int, exposure: float) -> Metadata:
    """Return the entries for `ImageLayout.metadata`; our version is in every file anyway.

    Args:
        stage: Name of the stage's root layer, as the user gave it.
        frame: Time code of the picture.
        samples: Pictures averaged over shutter, lens and pixel.
        exposure: What the camera multiplies linear light by.
    """
    return {
        "usdsplat:stage": stage,
        "usdsplat:frame": float(frame),
        "usdsplat:samples": samples,
        "usdsplat:exposure": float(exposure),
    }


def as_text(metadata: Metadata) -> dict[str, str]:
    """Return header entries for a format that holds text only: numbers and tuples as JSON."""
    return {
        key: value if isinstance(value, str) else json.dumps(value)
        for key, value in metadata.items()
    }
