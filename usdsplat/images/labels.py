"""Header entries that describe how a picture was made."""

from __future__ import annotations

import json

from usdsplat.core.text import shown
from usdsplat.images.layout import Metadata


def picture_metadata(*, stage: str, frame: float, samples: int, exposure: float) -> Metadata:
    """Return the entries for `ImageLayout.metadata`; writers add our version themselves.

    Args:
        stage: Root layer of the stage, as given by the user.
        frame: Time code of the picture.
        samples: Number of samples of shutter, lens and pixel.
        exposure: Factor of the camera on linear light.
    """
    return {
        "usdsplat:stage": shown(stage),
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
