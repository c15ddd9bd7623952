"""Artificial pictures, without a renderer."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.values import Picture, ViewState
from usdsplat.render.specs import CameraSpec


def camera() -> CameraSpec:
    """One that sees something."""
    return FreeCamera().spec(aspect=1.5, bounds=None)


def picture(*, number: int = 1, is_final: bool = True, **others: Any) -> Picture:
    """A gradient with a hard edge, 48 by 32."""
    image = np.zeros((32, 48, 3), np.uint8)
    image[..., 0] = np.arange(48) * 5
    image[..., 1] = np.arange(32)[:, None] * 8
    image[10:20, 10:30, 2] = 255
    values = {"state": ViewState(size=(48, 32)), "camera": camera(), "image": image}
    return Picture(number=number, is_final=is_final, **{**values, **others})
